"""`aa4d` needs no Blender: every module is imported, and a model trained, where bpy cannot be."""

import os
import subprocess
import sys
from pathlib import Path

PROGRAM = """
import pkgutil, sys
from importlib import import_module
from pathlib import Path
BLENDER = ("bpy", "bmesh", "mathutils", "bpy_extras", "gpu", "blf")
sys.modules |= dict.fromkeys(BLENDER)  # to import one is an ImportError
import aa4d
names = [module.name for module in pkgutil.walk_packages(aa4d.__path__, "aa4d.")]
assert len(names) > 100
for name in names:
    try:
        import_module(name)
    except ModuleNotFoundError as error:
        assert error.name not in BLENDER, (name, error)
from aa4d.capture.reader import read_capture
from aa4d.methods.model_file import load_model
from aa4d.training.trainer import train
from tests.toy_run import BRIEF, silent
model = train(read_capture(Path(sys.argv[1])), Path(sys.argv[2]), BRIEF, silent)
assert len(load_model(model).model)
"""


def test_it_imports_and_trains_without_blender(toy_capture: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-c", PROGRAM, str(toy_capture), str(tmp_path / "run")]
    # Nor is Blender's program in reach.
    environment = {"PATH": str(Path(sys.executable).parent), "HOME": str(tmp_path), "OMP_NUM_THREADS": "1"}
    environment["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).parents[1]), *filter(None, sys.path)])
    result = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=600, check=False)
    assert result.returncode == 0, result.stderr[-2000:]
