"""The packaged extension in this process's Blender."""

import importlib.util
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from model_files import make_model, write_model

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.fixture(scope="session")
def extension_zip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The extension as `make extension` builds it."""
    if importlib.util.find_spec("bpy") is None:
        pytest.skip("needs the bpy module")
    from addon.build_extension import build

    path = tmp_path_factory.mktemp("extension") / "adaanchor4d.zip"
    build(path)
    return path


@pytest.fixture(scope="module")
def extension(extension_zip: Path) -> Iterator[str]:
    """The extension installed and enabled in a repository of its own; the name of its module.

    Taken out again at the end: Blender 4.5 as a module hangs at exit while classes or handlers are registered.
    """
    with tempfile.TemporaryDirectory() as scratch:
        if "bpy" not in sys.modules:
            os.environ["BLENDER_USER_RESOURCES"] = scratch
        import bpy

        bpy.ops.wm.read_factory_settings(use_empty=True)
        import addon_utils  # importable once bpy is

        folder = Path(scratch, "aa4d_tests")
        folder.mkdir()
        bpy.ops.preferences.extension_repo_add(
            type="LOCAL", name="aa4d_tests", use_custom_directory=True, custom_directory=str(folder)
        )
        repositories = bpy.context.preferences.extensions.repos
        repository = repositories[-1].module
        bpy.ops.extensions.package_install_files(
            filepath=str(extension_zip), repo=repository, enable_on_install=True, overwrite=True
        )
        module = f"bl_ext.{repository}.adaanchor4d"
        assert addon_utils.check(module) == (True, True)
        yield module
        bpy.ops.extensions.package_uninstall(pkg_id="adaanchor4d", repo_index=len(repositories) - 1)
        assert addon_utils.check(module) == (False, False)
        assert not hasattr(bpy.types.Object, "aa4d")
        assert not [f for f in bpy.app.handlers.frame_change_pre if f.__module__.startswith(module)]
        bpy.ops.wm.read_factory_settings(use_empty=True)


@pytest.fixture
def bpy(extension: str) -> Any:
    """Blender with the extension and an empty file."""
    import addon_utils
    import bpy

    assert addon_utils.check(extension) == (True, True)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return bpy


@pytest.fixture
def native(bpy: Any) -> Any:
    """A Blender that draws splats itself."""
    if not hasattr(bpy.types, "GeometryNodePointsSetType"):
        pytest.skip(
            f"needs Blender 5.3 or later, this is {bpy.app.version_string}; test_addon_other_blenders.py runs it"
        )
    return bpy


@pytest.fixture
def model_path(tmp_path: Path) -> Path:
    """A small model of five frames, in a folder called crossing."""
    folder = tmp_path / "crossing"
    folder.mkdir()
    return write_model(folder / "model.safetensors", *make_model(60, 5))
