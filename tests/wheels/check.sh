#!/bin/sh
# A wheel in a clean environment: no compiler, no Blender, nothing of this checkout; it installs and trains.
# usage: check.sh PYTHON WHEEL [native]    native: where there is no torch for this Python, the C++ alone, on numpy arrays
set -eu
here=$(cd "$(dirname "$0")" && pwd)
wheel=$(cd "$(dirname "$2")" && pwd)/$(basename "$2")
clean=$(mktemp -d)
trap 'rm -rf "$clean"' EXIT
"$1" -m venv "$clean/venv"
cp "$here/../toy_capture.py" "$clean"
torch=$(sed -n 's/^torch==/torch==/p' "$here/../../constraints.txt")
cd "$clean"
# Nothing but the environment's own programs: what needs a compiler fails.
# pip's settings stay, which say where packages come from.
alone="env -i HOME=$HOME PATH=$clean/venv/bin OMP_NUM_THREADS=1 $(env | grep '^PIP_' | tr '\n' ' ')"
for tool in gcc g++ cc c++ clang cmake ninja blender; do
  if $alone "$(command -v sh)" -c "command -v $tool" >/dev/null; then echo "check.sh: $tool is in reach"; exit 1; fi
done
install="$alone python -m pip install --quiet --disable-pip-version-check --only-binary :all:"
if [ "${3-}" = native ]; then
  $install numpy
  $install --no-deps "$wheel"
  cp "$here/draw.py" "$clean"
  $alone python draw.py
  echo "$(basename "$wheel"): installs without a compiler and draws; without torch nothing else was tried"
  exit 0
fi
$install "$torch" "$wheel"
$alone python -c "
import importlib.util
from pathlib import Path
import aa4d
assert Path(aa4d.__file__).is_relative_to('$clean'), aa4d.__file__
assert importlib.util.find_spec('bpy') is None
from toy_capture import write_toy_capture
write_toy_capture(Path('capture'))"
$alone aa4d train capture --out run --preset quick --iterations 20 30 --motion none
$alone aa4d eval run
$alone aa4d render run --frames 3
$alone aa4d bench raster --help >/dev/null
echo "$(basename "$wheel"): installs without a compiler and trains"
