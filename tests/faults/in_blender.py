"""What a person does with the extension: import, bake and save, or export. `in_blender.py MODEL ZIP FOLDER WHAT`

Says the operator's error in one line, with exit code 2.
"""

import hashlib
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any


def baked(bpy: Any) -> dict[str, str]:
    """A digest of every attribute of the saved points, by its name."""
    found = {}
    for mesh in bpy.data.meshes:
        for attribute in mesh.attributes:
            rows = [
                next(getattr(item, k) for k in ("value", "vector", "color") if hasattr(item, k))
                for item in attribute.data
            ]
            text = repr([value if isinstance(value, (int, float, bool)) else tuple(value) for value in rows])
            found[f"{mesh.name} {attribute.name}"] = hashlib.sha256(text.encode()).hexdigest()
    return found


def main(model: str, package: str, folder: str, what: str) -> int:
    if not os.environ.get("BLENDER_USER_RESOURCES"):
        os.environ["BLENDER_USER_RESOURCES"] = tempfile.mkdtemp(dir=Path(package).parent)
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    place = tempfile.mkdtemp(dir=Path(package).parent)
    bpy.ops.preferences.extension_repo_add(
        type="LOCAL", name="aa4d_faults", use_custom_directory=True, custom_directory=place
    )
    repository = bpy.context.preferences.extensions.repos[-1].module
    bpy.ops.extensions.package_install_files(filepath=package, repo=repository, enable_on_install=True, overwrite=True)
    bpy.ops.aa4d.import_model(filepath=model, bake=what == "bake")
    try:
        if what == "bake":
            bpy.ops.aa4d.bake()
            bpy.ops.wm.save_as_mainfile(filepath=f"{folder}/baked.blend")
            bpy.ops.wm.open_mainfile(filepath=f"{folder}/baked.blend")
            Path(folder, "baked.json").write_text(json.dumps(baked(bpy)))
        elif what == "ply":
            bpy.ops.aa4d.export_ply(filepath=f"{folder}/out.ply", use_range=True)
        else:
            bpy.ops.aa4d.export_usd(filepath=f"{folder}/out.usdc", use_range=True)
    except RuntimeError as error:
        print(str(error).strip(), file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    code = 1
    try:
        code = main(*sys.argv[1:])
    except Exception:
        import traceback

        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # Blender 4.5 as a module can hang in its own exit
