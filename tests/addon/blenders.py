"""Other Blenders: bpy modules in environments of their own, made on first use beside .venv."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from filelock import FileLock

ROOT = Path(__file__).resolve().parents[2]
NEEDS = ("numpy", "pillow", "pytest")


def python_of(version: str) -> str | None:
    """A Python of this version: on PATH, or of pyenv."""
    found = shutil.which(f"python{version}")
    pyenv = sorted(
        Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions").glob(f"{version}.*/bin/python")
    )
    candidates = [*([found] if found else []), *map(str, pyenv)]
    for candidate in candidates:  # pyenv's shims are on PATH for versions that are not chosen, and fail
        if subprocess.run([candidate, "-c", ""], capture_output=True, check=False).returncode == 0:
            return candidate
    return None


def environment(name: str, python_version: str, bpy_version: str) -> Path:
    """The Python of an environment with this bpy, made where it is missing."""
    python = python_of(python_version)
    if python is None:
        pytest.skip(f"bpy {bpy_version} needs Python {python_version}, which is neither on PATH nor in pyenv")
    folder = ROOT / name
    inside, stamp = folder / "bin" / "python", folder / "installed"
    with FileLock(ROOT / f"{name}.lock"):  # tests run side by side
        if not stamp.exists():
            _install(python, folder, bpy_version)
            stamp.touch()
    return inside


def _install(python: str, folder: Path, bpy_version: str) -> None:
    subprocess.run([python, "-m", "venv", "--clear", str(folder)], check=True, timeout=120)
    install = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    done = subprocess.run(
        [*install, f"bpy=={bpy_version}", *NEEDS], capture_output=True, text=True, timeout=900, check=False
    )
    if done.returncode != 0:
        shutil.rmtree(folder)
        pytest.skip(f"bpy {bpy_version} could not be installed: {done.stderr.strip().splitlines()[-1]}")
