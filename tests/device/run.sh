#!/bin/sh
# The whole check of the GPU path on a machine without a network, from what tests/device/pack.sh gathered:
#
#   sh tests/device/run.sh [SECONDS] [options of python -m tests.device]
#
# The JSON is build/device/result.json. What later runs can use on a bare machine (the JSON, gsplat's wheel, the models)
# is copied to the folder that OUT names, if it names one. Run again, it does what is not done yet.
set -u
cd "$(dirname "$0")/../.."
budget=${1:-540}
[ $# -gt 0 ] && shift
python=${PYTHON:-python3}
out=build/device
site=$PWD/$out/site
began=$(date +%s)
mkdir -p "$site"
# A package that the machine has is used as it is there.
for wheel in "$out"/wheels/*.whl; do
    name=$(basename "$wheel" | cut -d - -f 1)
    "$python" -c "import importlib.metadata, sys; importlib.metadata.version(sys.argv[1])" "$name" 2>/dev/null \
        || "$python" -m pip install -q --no-index --no-deps --target "$site" "$wheel"
done
export PYTHONPATH="$site${PYTHONPATH:+:$PYTHONPATH}"
# Here, Python finds the checkout's aa4d before any other: what is compiled goes into it.
if ! "$python" -c "from aa4d._native import raster" 2>/dev/null; then
    ls "$out"/aa4d-*.whl >/dev/null 2>&1 \
        || "$python" -m pip wheel -q --no-index --no-deps --no-build-isolation -w "$out" .
    "$python" -m zipfile -e "$out"/aa4d-*.whl "$out/aa4d-wheel" && cp "$out"/aa4d-wheel/aa4d/_native*.so aa4d/
fi
took=$(($(date +%s) - began))
echo "aa4d and its packages: $took s"

carried=
[ -d "$out/capture" ] && carried="$carried --capture $out/capture"
[ -f "$out/model.safetensors" ] && carried="$carried --model $out/model.safetensors"
# shellcheck disable=SC2086 # the paths have no spaces
"$python" -m tests.device --out "$out/result.json" --work "$out/work" --carried "$out" \
    --budget-s $((budget - took)) $carried "$@"
status=$?
if [ -n "${OUT:-}" ]; then
    cp "$out/result.json" "$OUT/" 2>/dev/null
    cp "$out"/work/wheels/gsplat-*.whl "$OUT/" 2>/dev/null
    for run in "$out"/work/runs/*; do
        [ -f "$run/model.safetensors" ] && cp "$run/model.safetensors" "$OUT/$(basename "$run").safetensors"
    done
fi
exit $status
