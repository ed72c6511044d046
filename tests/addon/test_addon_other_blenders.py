"""The same tests in other Blenders: bpy modules of 5.3, 5.2 LTS and 5.0 in environments of their own, and a real one.

The environments are made on first use in .venv-blender53, .venv-blender52 and .venv-blender50, beside .venv.
"""

import importlib
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from blenders import environment
from model_files import make_model, write_model

ROOT = Path(__file__).resolve().parent.parent.parent
FILES = (
    *("blender", "clip_playback", "inspection", "links", "export", "compositing", "interface", "vehicles"),
    *("kept_changes", "frame_rates", "tracks", "splats", "harmonics", "trained_picture", "projected", "camera_path"),
)
# What a version can break: installing, evaluating, node groups, baking, saving, undo, rendering.
ESSENTIAL = (
    "disables_and_enables or panels_draw or live_points_follow or draws_what or bake_equals_live or baked_file_needs "
    "or drone_camera or save_and_reload or undo or deleted_by_hand or rendered_colour or clip_time_live or keyed "
    "or colours_show or ghosts or filters or discs or usd or splats or relinked or motion_blur or passes or shadow "
    "or vehicle or orphaned or dropped or duplicate or applied or stands_still "
    "or softness or harmonics or labels_are_whole or half_transparent or restores or as_it_came_in "
    "or keeps_its_seconds or half_an_import or nothing_shown or without_cycles or without_usd or first_sight or track "
    "or rasteriser or stretched_object or light_comes or behind_the_camera"
)


def run_tests(python: Path, expression: str, timeout: int) -> str:
    """Run the add-on's tests there; their summary."""
    # The outer conftest is for torch, which is not there.
    command = [str(python), "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", os.devnull, "--rootdir", "."]
    command += ["--confcutdir", "."]
    files = [f"test_addon_{name}.py" for name in FILES]
    settings = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [*command, *files, "-k", expression],
        cwd=Path(__file__).parent,
        env=settings,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-1000:]
    return done.stdout


# Saves what an import shows as a file, in whichever Blender runs it: ZIP MODEL FILE.
SAVE = """
import os, sys, tempfile
package, model, file = sys.argv[1:]
scratch = tempfile.mkdtemp()
os.environ["BLENDER_USER_RESOURCES"] = scratch
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.preferences.extension_repo_add(
    type="LOCAL", name="saving", use_custom_directory=True, custom_directory=scratch
)
repository = bpy.context.preferences.extensions.repos[-1].module
bpy.ops.extensions.package_install_files(filepath=package, repo=repository, enable_on_install=True)
bpy.ops.aa4d.import_model(filepath=model, carrier="GAUSSIANS", bake=True)
bpy.ops.wm.save_as_mainfile(filepath=file)
sys.stdout.flush()
os._exit(0)
"""


def test_file_with_splats_opens_before_5_3(
    bpy: Any, extension: str, extension_zip: Path, model_path: Path, tmp_path: Path, capfd: Any
) -> None:
    """It shows Gaussians instead, with this extension and without it, and says so once."""
    if hasattr(bpy.types, "GeometryNodePointsSetType"):
        pytest.skip("this Blender has splats of its own; an older one opens the file")
    python, file = environment(".venv-blender53", "3.13", "5.3.*"), tmp_path / "splats.blend"
    command = [str(python), "-c", SAVE, str(extension_zip), str(model_path), str(file)]
    subprocess.run(command, check=True, timeout=300, capture_output=True)
    capfd.readouterr()
    bpy.ops.wm.open_mainfile(filepath=str(file))
    assert "".join(capfd.readouterr()).count("Native Splats need Blender 5.3") == 1
    obj = next(obj for obj in bpy.data.objects if obj.aa4d.filepath)
    looks = importlib.import_module(f"{extension}.modifiers").values_of(obj.modifiers["AdaAnchor4D"])
    assert looks["Look"] == "Native Splats"
    instances = [i for i in bpy.context.evaluated_depsgraph_get().object_instances if i.is_instance]
    assert 0 < len(instances) <= len(obj.data.vertices)


# What artists do first; the slow tests do the rest.
FIRST = f"({ESSENTIAL}) and (import or bake or drop or playback"


def test_in_blender_5_3() -> None:
    """With what this Blender has of its own, and what stands in for it in older ones."""
    expression = f"{FIRST} or splats or harmonics or projected or trained_picture)"
    summary = run_tests(environment(".venv-blender53", "3.13", "5.3.*"), expression, 900)
    assert int(re.findall(r"(\d+) passed", summary)[-1]) > 60


def test_in_blender_5_2() -> None:
    summary = run_tests(environment(".venv-blender52", "3.13", "5.2.*"), f"{FIRST})", 600)
    assert int(re.findall(r"(\d+) passed", summary)[-1]) > 20


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "python_version", "bpy_version"),
    [(".venv-blender53", "3.13", "5.3.*"), (".venv-blender52", "3.13", "5.2.*"), (".venv-blender50", "3.11", "5.0.*")],
)
def test_everything_in(name: str, python_version: str, bpy_version: str) -> None:
    summary = run_tests(environment(name, python_version, bpy_version), "not unusable_file", 1800)
    assert int(re.findall(r"(\d+) passed", summary)[-1]) > 60


def test_in_a_real_blender(extension_zip: Path, tmp_path: Path) -> None:
    """Whatever blender is on PATH, from 4.5 on: install, import, bake, save, render."""
    blender = shutil.which("blender")
    if blender is None:
        pytest.skip("no blender on PATH")
    version = subprocess.run([blender, "--version"], capture_output=True, text=True, timeout=60, check=False).stdout
    numbers = re.search(r"Blender (\d+)\.(\d+)", version)
    if numbers is None or (int(numbers[1]), int(numbers[2])) < (4, 5):
        pytest.skip(f"the blender on PATH is {version.splitlines()[0] if version else 'unknown'}; 4.5 is needed")
    model = write_model(tmp_path / "model.safetensors", *make_model(300))
    script = ROOT / "addon" / "make_flyover_blend.py"
    command = [blender, "-b", "-P", str(script), "--", str(model), "--extension", str(extension_zip)]
    outputs = ["--out", str(tmp_path / "flyover.blend"), "--render", str(tmp_path / "frame.png")]
    done = subprocess.run([*command, *outputs], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "flyover.blend").stat().st_size > 10_000
    assert (tmp_path / "frame.png").stat().st_size > 1_000
