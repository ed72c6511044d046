"""Build the extension: python addon/build_extension.py OUT.zip

An extension's package must lie at the root of its zip, beside the manifest. This stages the two there, leaves out what
only developers run, and has Blender's own tool build and validate.
"""

import argparse
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DEVELOPERS_ONLY = ("build_extension.py", "make_flyover_blend.py", "bench_addon.py", "__pycache__")


def extension_command() -> list[str]:
    """How to call Blender's extension tool: the script inside the bpy module, or a blender on PATH.

    Raises:
        FileNotFoundError: neither is there.
    """
    module = importlib.util.find_spec("bpy")  # looks, without importing
    if module is not None and module.origin is not None:
        tools = sorted(Path(module.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
        if tools:
            return [sys.executable, str(tools[-1])]
    blender = shutil.which("blender")
    if blender is not None:
        return [blender, "--command", "extension"]
    raise FileNotFoundError("Building the extension needs the bpy module (pip install bpy) or blender on PATH.")


def build(out: Path) -> None:
    """Write the validated extension to `out`.

    Raises:
        FileNotFoundError: no Blender.
        subprocess.CalledProcessError: Blender's tool refuses the package; its message is in `stdout`.
    """
    command = extension_command()
    out = out.resolve()
    out.parent.mkdir(parents=True, exist_ok=True)
    folder = out.with_name(f".{out.name}.part")
    shutil.rmtree(folder, ignore_errors=True)  # of a killed process
    folder.mkdir()
    try:
        stage, built = folder / "stage", folder / "built.zip"
        shutil.copytree(ROOT / "addon", stage, ignore=shutil.ignore_patterns(*DEVELOPERS_ONLY))
        for name in ("blender_manifest.toml", "LICENSE"):
            shutil.copy(ROOT / name, stage)
        for arguments in (
            ["build", "--source-dir", str(stage), "--output-filepath", str(built)],
            ["validate", str(built)],
        ):
            subprocess.run(command + arguments, check=True, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        os.replace(built, out)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description="Build the AdaAnchor4D extension for Blender.")
    parser.add_argument("out", type=Path, help="the zip to write")
    out = parser.parse_args().out
    try:
        build(out)
    except OSError as error:
        print(error, file=sys.stderr)
        return 2
    except subprocess.CalledProcessError as error:
        said = error.stdout.strip()
        print(said.splitlines()[-1] if "Traceback" in said else said or error, file=sys.stderr)
        return 2
    print(f"Wrote {out} ({out.stat().st_size / 1024:.0f} KiB)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
