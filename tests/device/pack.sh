#!/bin/sh
# Gathers in build/device/ what a machine with a GPU, Python 3.12 and PyTorch but without a network needs besides this
# checkout: gsplat's source archive, the wheels that are most often missing there, a capture and a trained model.
#
#   sh tests/device/pack.sh CAPTURE [MODEL.safetensors]
#
# PYTHON names a Python with PyTorch and pip (.venv/bin/python). It prints what there is to carry, and its size.
set -eu
cd "$(dirname "$0")/../.."
capture=${1:?usage: sh tests/device/pack.sh CAPTURE [MODEL.safetensors]}
model=${2:-}
python=${PYTHON:-.venv/bin/python}
out=build/device
limit_mib=64
mkdir -p "$out/wheels"

# gsplat asks for PyTorch, setuptools and wheel to tell its own name; without CUDA it compiles nothing for that.
"$python" -m pip install -q setuptools wheel
if [ ! -f "$out/gsplat-1.5.3.tar.gz" ]; then
    BUILD_NO_CUDA=1 "$python" -m pip download -q --no-deps --no-build-isolation --no-binary :all: -d "$out" gsplat==1.5.3
fi

# What aa4d and gsplat import and a machine for machine learning may lack. All others are compiled packages that it has
# (numpy, scipy, opencv-python-headless, pillow, matplotlib, safetensors), or what no part of the check imports.
for package in tyro==1.0.17 docstring-parser typeguard plyfile jaxtyping wadler-lindig filelock rich markdown-it-py \
    mdurl pygments jinja2 markupsafe scikit-build-core pathspec packaging nanobind typing-extensions; do
    "$python" -m pip download -q --no-deps --only-binary :all: --python-version 3.12 --implementation cp \
        --platform manylinux_2_28_x86_64 --platform manylinux_2_17_x86_64 --platform manylinux2014_x86_64 \
        -d "$out/wheels" "$package"
done

# Whole: its checksums name every file.
rm -rf "$out/capture"
cp -r "$capture" "$out/capture"
if [ -n "$model" ]; then cp "$model" "$out/model.safetensors"; fi

echo "to carry, beside the files that git knows:"
(cd "$out" && du -sm gsplat-*.tar.gz gsplat-*.whl wheels capture model.safetensors 2>/dev/null || true)
carried=$(cd "$out" && du -scm gsplat-*.tar.gz gsplat-*.whl wheels capture model.safetensors 2>/dev/null | tail -n 1 | cut -f 1)
tracked=$(git ls-files -z | du -cm --files0-from=- | tail -n 1 | cut -f 1)
echo "MiB: $carried carried + $tracked tracked by git = $((carried + tracked)) of $limit_mib"
[ $((carried + tracked)) -le $limit_mib ]
