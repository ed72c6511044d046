# Two commands do everything: `make demo` runs the main job, `make test` passes the tests. Both make .venv first.
PYTHON ?= python3.11
VENV := .venv
# Processes that share out the test files.
JOBS ?= 2
BIN := $(VENV)/bin
NATIVE := $(shell find aa4d/_native -type f 2>/dev/null)

.PHONY: help demo test test-slow lint extension bench-addon clean

help:
	@echo "make demo       the main job on scenes/crossroads.toml; the result is in demo/"
	@echo "make test       lint, types and all tests but the slow ones; JOBS=4 shares them out over more processes"
	@echo "make test-slow  the slow tests"
	@echo "make extension  the Blender extension, as a zip in dist/"
	@echo "make bench-addon  what the extension costs, into dist/bench-addon.json (minutes); MODEL=... adds accuracy"
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
	$(BIN)/python -m pytest -m "not slow" --numprocesses $(JOBS) --dist loadfile

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

bench-addon: extension
	$(BIN)/python addon/bench_addon.py --extension dist/adaanchor4d.zip --json dist/bench-addon.json \
		$(if $(MODEL),--model $(MODEL))

clean:
	rm -rf $(VENV) .venv-blender* build dist demo .pytest_cache .mypy_cache .ruff_cache
