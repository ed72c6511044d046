#!/bin/sh
# Wheels of aa4d for every CPython from 3.11 to 3.13 that is here (on PATH, or pyenv's), into a folder; each is checked
# in a clean environment. They run wherever glibc is not older than the tag in their name says.
# usage: build.sh FOLDER [PYTHON...]    auditwheel and patchelf have to be on PATH
set -eu
out=$1
shift
here=$(dirname "$0")
if [ $# -eq 0 ]; then
  for version in 3.11 3.12 3.13; do
    for python in "python$version" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$version".*/bin/python; do
      if "$python" -c "import sys; sys.exit(f'{sys.version_info[0]}.{sys.version_info[1]}' != '$version')" 2>/dev/null; then
        set -- "$@" "$python"
        break
      fi
    done
  done
fi
mkdir -p "$out"
for python in "$@"; do
  echo "== $("$python" --version)"
  raw=$(mktemp -d)
  "$python" -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir "$raw" .
  auditwheel repair --wheel-dir "$raw/repaired" "$raw"/aa4d-*.whl
  mv "$raw"/repaired/aa4d-*.whl "$out"
  sh "$here/check.sh" "$python" "$out"/aa4d-*-"$("$python" -c 'import sys; print("cp%d%d" % sys.version_info[:2])')"-*.whl
  rm -r "$raw"
done
