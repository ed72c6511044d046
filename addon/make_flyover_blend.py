"""Make a .blend that opens on a trained scene, with the packaged extension; and render one frame of it.

    python addon/make_flyover_blend.py MODEL --extension ZIP --out flyover.blend [--render frame.png] ...
    blender -b -P addon/make_flyover_blend.py -- MODEL --extension ZIP --out flyover.blend ...

The file is baked: it plays and renders in a Blender without the extension.
"""

import argparse
import os
import shutil
import signal
import sys
import tempfile
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

SAMPLES = 16  # the materials only emit: samples smooth edges, there is no light to gather
GAUSSIAN_SAMPLES = 4  # a sample passes through dozens of Gaussians; what noise is left, denoising takes out
FAINTEST = 0.05  # the modifier's own default for Minimum Opacity
SEEK_TABLE = bytes.fromhex("b1ea928f")  # ends a compressed .blend: Zstandard's seekable format
IEND = bytes.fromhex("0000000049454e44ae426082")  # ends a PNG: its last chunk, empty, and that one's checksum
REPOSITORY = "aa4d_flyover"
SCRATCH_BYTES = 16 << 20  # for the unpacked extension and what Blender keeps beside it


def arguments() -> argparse.Namespace:
    """The command line: after `--` in Blender, everything in plain Python."""
    given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    parser = argparse.ArgumentParser(prog="make_flyover_blend.py", description="Make a .blend of a trained scene.")
    parser.add_argument("model", type=Path, help="model.safetensors")
    parser.add_argument("--extension", type=Path, required=True, help="the zip that build_extension.py wrote")
    parser.add_argument("--out", type=Path, required=True, help="the .blend to write")
    parser.add_argument(
        "--gaussians", action="store_true", help="render the local Gaussians instead of the anchors: slower, far finer"
    )
    parser.add_argument("--render", type=Path, help="also render one frame to this PNG")
    parser.add_argument(
        "--car",
        type=float,
        nargs=4,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="drive a CG car from one place to another (metres) over the clip, lit, hidden and shadowed by the scene",
    )
    parser.add_argument("--frame", type=int, help="which frame to open on and to render; the middle one by default")
    return parser.parse_args(given)


interrupted = False


def remember_interrupt(*_: object) -> None:
    global interrupted
    interrupted = True


def stop_if_asked() -> None:
    """Ctrl-C takes effect here: inside an operator Blender would make an error of its own of it, or lose it."""
    signal.signal(signal.SIGINT, remember_interrupt)  # again each time: Blender sets its own when it loads
    if interrupted:
        raise KeyboardInterrupt


@contextmanager
def quiet() -> Iterator[None]:
    """Silence standard output, to which Blender writes a line for every step of a render. Errors are not silenced."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def make(options: argparse.Namespace, scratch: str) -> None:
    """Install, import, bake, save, render.

    Raises:
        RuntimeError, OSError: an unusable model or extension, a folder that cannot be written.
    """
    # Blender says nothing of a full disk when it installs what it cannot write.
    if shutil.disk_usage(scratch).free < SCRATCH_BYTES:
        raise OSError(
            f"{scratch}: less than {SCRATCH_BYTES >> 20} MiB are free; free some space there, or set TMPDIR to a "
            "folder on another disk"
        )
    import bpy

    stop_if_asked()
    # Factory settings and a repository of our own: whatever the person has installed or configured stays out of it.
    bpy.ops.wm.read_factory_settings()
    extensions = os.path.join(scratch, "flyover")
    os.makedirs(extensions)
    bpy.ops.preferences.extension_repo_add(
        type="LOCAL", name=REPOSITORY, use_custom_directory=True, custom_directory=extensions
    )
    repository = bpy.context.preferences.extensions.repos[-1].module
    bpy.ops.extensions.package_install_files(
        filepath=str(options.extension.resolve()), repo=repository, enable_on_install=True, overwrite=True
    )
    module = f"bl_ext.{repository}.adaanchor4d"
    if module not in bpy.context.preferences.addons:
        raise RuntimeError(f"{options.extension} is not the extension; build it with addon/build_extension.py.")
    try:
        build_scene(options)
    finally:
        # Blender 4.5 as a module hangs at exit while classes or handlers of an add-on are registered.
        bpy.ops.preferences.addon_disable(module=module)


def build_scene(options: argparse.Namespace) -> None:
    """Fill the start-up scene, save it, and render."""
    import bpy

    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    bpy.ops.outliner.orphans_purge(do_recursive=True)
    stop_if_asked()
    bpy.ops.aa4d.import_model(filepath=str(options.model.resolve()), carrier="ANCHORS", set_up_scene=True, bake=True)
    stop_if_asked()
    scene = bpy.context.scene
    points = bpy.context.active_object
    points.select_set(False)
    frame = options.frame if options.frame is not None else (scene.frame_start + scene.frame_end) // 2
    if not scene.frame_start <= frame <= scene.frame_end:
        raise RuntimeError(f"--frame {frame} is outside the clip, {scene.frame_start} to {scene.frame_end}.")
    if options.gaussians:
        for obj in imported():
            obj.hide_render = True
        add_gaussians(options)
    for obj in imported():
        obj.aa4d.filepath = bpy.path.relpath(str(options.model.resolve()), start=str(options.out.resolve().parent))
    if options.car is not None:
        add_car(points, options.car)
    scene.frame_set(frame)
    scene.cycles.samples = GAUSSIAN_SAMPLES if options.gaussians else SAMPLES
    scene.cycles.use_denoising = options.gaussians  # transparency is sampled; bare points have no noise to take out
    scene.cycles.max_bounces = 2 if options.car is not None else 0
    scene.render.resolution_percentage = max(100, round(100 * 640 / scene.render.resolution_x))
    for screen in bpy.data.screens:
        for area in screen.areas:
            if area.type == "VIEW_3D":
                view = area.spaces.active
                view.region_3d.view_perspective = "CAMERA"
                view.shading.type = "MATERIAL"
                view.shading.use_scene_world = True
                view.clip_end = scene.camera.data.clip_end
    bpy.context.preferences.filepaths.save_version = 0  # no flyover.blend1 beside it
    with whole(options.out.resolve(), SEEK_TABLE) as partial:
        bpy.ops.wm.save_as_mainfile(filepath=str(partial), compress=True)
    stop_if_asked()
    if options.render is not None:
        if options.gaussians and options.car is None:
            # As `aa4d render` draws it, in a fifth of the time. The .blend, saved without, takes lights and things.
            bpy.ops.aa4d.trained_picture(use=True)
            scene.cycles.samples = 1
        scene.render.image_settings.file_format = "PNG"
        with whole(options.render.resolve(), IEND) as partial:
            scene.render.filepath = str(partial)
            bpy.ops.render.render(write_still=True)


@contextmanager
def whole(path: Path, ending: bytes) -> Iterator[Path]:
    """A temporary file beside `path` for Blender to write; it replaces `path` if it ends as such files do.

    Raises:
        OSError: it does not. Blender says nothing where the disk was full.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.stem}.part{path.suffix}")  # what a killed process left is written over
    try:
        try:
            yield partial
        except RuntimeError as error:
            reason = " ".join(str(error).split()).removeprefix("Error: ")
            raise OSError(f"{path}: could not be written ({reason}); free some space and run again") from None
        if not partial.is_file() or not partial.read_bytes().endswith(ending):
            raise OSError(f"{path}: could not be written whole; free some space and run the same command again")
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def imported() -> list[Any]:
    """The objects that show a model, vehicles among them."""
    import bpy

    return [obj for obj in bpy.context.scene.objects if obj.type == "MESH" and obj.aa4d.filepath]


def add_gaussians(options: argparse.Namespace) -> None:
    """Bake the local Gaussians as further objects that are seen in renders alone.

    Those that are transparent in every frame, often half of them, are deleted first: keys of all would be heavy.
    """
    import bpy
    import numpy as np

    before = imported()
    bpy.ops.aa4d.import_model(
        filepath=str(options.model.resolve()), carrier="GAUSSIANS", import_camera=False, set_timeline=False
    )
    scene, made = bpy.context.scene, [obj for obj in imported() if obj not in before]
    looks = [obj.modifiers["AdaAnchor4D"] for obj in made]
    for look in looks:
        look.show_viewport = False  # nothing is drawn here
    opacity = [np.zeros(len(obj.data.vertices), np.float32) for obj in made]
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        for obj, largest in zip(made, opacity, strict=True):
            now = np.empty_like(largest)
            obj.data.attributes["aa_opacity"].data.foreach_get("value", now)
            np.maximum(largest, now, out=largest)
    for obj, largest in zip(made, opacity, strict=True):
        obj.data.vertices.foreach_set("select", largest < FAINTEST)
        obj.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")  # of all that are selected
    bpy.ops.mesh.delete(type="VERT")
    bpy.ops.object.mode_set(mode="OBJECT")
    stop_if_asked()
    bpy.ops.aa4d.bake()
    stop_if_asked()
    for obj, look in zip(made, looks, strict=True):
        look.show_viewport = True
        obj.select_set(False)
        obj.hide_viewport = True


def add_car(points: Any, path: list[float]) -> None:
    """A car of a few boxes that drives along `path`, on the ground, under a sun; the reconstruction is lit."""
    import importlib

    import bpy
    import numpy as np

    scene = bpy.context.scene
    leads = [obj for obj in imported() if obj.parent is None and not obj.hide_render]
    for obj in leads:  # their vehicles go with them
        obj.hide_viewport = False
        bpy.context.view_layer.objects.active = obj
        bpy.ops.aa4d.set_up_compositing(mode="SCENE")
        obj.hide_viewport = obj is not points
    package = next(name for name in sys.modules if name.endswith(".adaanchor4d"))
    compositing = importlib.import_module(f"{package}.compositing")
    places = np.empty(3 * len(points.data.vertices), np.float32)
    points.data.attributes["position"].data.foreach_get("vector", places)
    ground = compositing.fit_ground(places.reshape(-1, 3))
    paint = bpy.data.materials.new("Car Paint")
    if bpy.app.version < (5, 0):
        paint.use_nodes = True
    shader = next(node for node in paint.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value, shader.inputs["Roughness"].default_value = (1.0, 0.25, 0.0, 1.0), 0.3
    car = bpy.data.objects.new("CG Car", None)
    scene.collection.objects.link(car)
    for name, size, place in (
        ("Body", (4.4, 1.8, 0.8), (0, 0, 0.7)),
        ("Cabin", (2.2, 1.6, 0.6), (-0.2, 0, 1.4)),
        *((f"Wheel {x} {y}", (0.6, 0.2, 0.6), (x, y, 0.3)) for x in (-1.4, 1.4) for y in (-0.85, 0.85)),
    ):
        bpy.ops.mesh.primitive_cube_add(size=1)
        part = bpy.context.active_object
        part.name, part.scale, part.location, part.parent = name, size, place, car
        part.data.materials.append(paint)
        part.select_set(False)
    ends = np.array(path).reshape(2, 2)
    car.rotation_euler = (0, 0, float(np.arctan2(*(ends[1] - ends[0])[::-1])))
    for frame, xy in zip((scene.frame_start, scene.frame_end), ends, strict=True):
        car.location = (*xy, float(ground.z(xy)))
        car.keyframe_insert("location", frame=frame)
    for curve in car.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    world = scene.world.node_tree.nodes
    next(node for node in world if node.type == "BACKGROUND").inputs["Strength"].default_value = 1.0


def main() -> int:
    """Command line."""
    options = arguments()
    with tempfile.TemporaryDirectory() as scratch:
        if "bpy" not in sys.modules:  # in Blender itself it is too late, and factory settings must do
            os.environ["BLENDER_USER_RESOURCES"] = scratch
        try:
            with quiet():
                make(options, scratch)
        except (RuntimeError, OSError) as error:
            print(" ".join(str(error).split()), file=sys.stderr)
            return 2
    print(f"Saved {options.out}")
    if options.render is not None:
        print(f"Rendered {options.render}")
    return 0


if __name__ == "__main__":
    code = 1
    try:
        stop_if_asked()
        code = main()
    except SystemExit as stop:  # the argument parser's
        code = int(stop.code or 0)
    except KeyboardInterrupt:
        print("Interrupted; the same command starts over.", file=sys.stderr)
        code = 130
    except Exception:
        traceback.print_exc()
    if "bpy" in sys.modules:
        shutil.rmtree(sys.modules["bpy"].app.tempdir, ignore_errors=True)  # only Blender's own exit would
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # Blender 4.5 as a module can hang in its own exit
