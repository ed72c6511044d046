"""What the extension costs, measured as packaged: python addon/bench_addon.py --extension ZIP --json OUT [--model M]

Models are random, of the sizes that `aa4d train` writes by default. Each measurement is the best of several: other
programs only ever make it slower, and change the time of the processor least. `--model` adds what cheaper evaluations
of a trained model cost in accuracy; `--pictures` its renders against those of `aa4d render`, PNGs of the same names.
"""

import argparse
import importlib
import json
import os
import shutil
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

FRAMES = 12
REPEATS = 5
SIZES = {"K": 10, "F": 32, "E": 32, "C": 16, "B": 64}  # of the default configuration
ANCHORS = (20_000, 100_000)  # and ten times as many local Gaussians


class Render(NamedTuple):
    """How the pictures of one row are rendered."""

    look: str
    samples: int  # Samples of each pixel: one where nothing is left to chance, a few for ellipsoids, many for splats
    trained_picture: bool
    seen_from: str = "CAPTURE"  # or FROZEN, at the mean of the capture's cameras
    harmonics: int = 0  # degree


RENDERS = (
    Render("Gaussians", 4, False),
    Render("Gaussians", 1, True),
    Render("Native Splats", 4, False),
    Render("Native Splats", 4, True),
    Render("Native Splats", 64, False),
    Render("Native Splats", 64, True),
    Render("Native Splats", 64, True, "FROZEN"),
    Render("Native Splats", 64, True, "FROZEN", 1),
)


def random_model(path: Path, anchors: int) -> None:
    """Write a model of the default sizes with random weights."""
    random = np.random.default_rng(anchors)
    K, F, E, C, B = SIZES.values()

    def normal(*shape: int, scale: float = 1.0) -> np.ndarray:
        return np.float32(scale) * random.standard_normal(shape, dtype=np.float32)

    tensors = {
        "anchors.position": random.uniform(-1, 1, (anchors, 3)).astype(np.float32) * np.array([1, 1, 0.1], np.float32),
        "anchors.feature": normal(anchors, F),
        "anchors.offset": normal(anchors, K, 3),
        "anchors.log_scale": normal(anchors, 6, scale=0.3) - 5,
        "field.box": np.array([[-1, -1, -1], [1, 1, 1]], np.float32),
        "warp.boundaries": np.tile(np.linspace(-1, 1, B + 1, dtype=np.float32), (3, 1)),
    }
    tensors.update({f"anchors.embedding_{name}": normal(anchors, E) for name in ("acfa", "offset", "scale")})
    for level, resolution in enumerate((64, 128)):
        for plane in ("xy", "xz", "yz", "xt", "yt", "zt"):
            rows = 25 if plane.endswith("t") else resolution
            tensors[f"field.planes.{level}.{plane}"] = normal(C, rows, resolution, scale=0.3)
    layers = {
        "acfa": (E + 1, 256, 6 * C, 1.0),
        "head_position": (128, 128, 3, 0.05),
        "head_feature": (128, 128, F, 0.3),
        "dlgd_offset": (E + 1, 128, 3 * K, 0.1),
        "dlgd_scale": (E + 1, 128, 6, 0.1),
        "decoder_opacity": (F + 3, 32, K, 1.0),
        "decoder_color": (F + 3, 32, 3 * K, 1.0),
        "decoder_covariance": (F + 3, 32, 7 * K, 1.0),
    }
    sizes = {"encoder": (2 * C, 128, 1.0)}
    for name, (inputs, hidden, outputs, gain) in layers.items():
        sizes[f"{name}.hidden"], sizes[f"{name}.output"] = (inputs, hidden, 1.0), (hidden, outputs, gain)
    for name, (inputs, outputs, gain) in sizes.items():
        tensors[f"{name}.weight"] = normal(outputs, inputs, scale=gain / inputs**0.5)
        tensors[f"{name}.bias"] = normal(outputs, scale=0.1)
    view = np.array([[1.0, 0, 0, 0], [0, -0.6, -0.8, 0], [0, 0.8, -0.6, 90], [0, 0, 0, 1]])
    information = {
        "format": "aa4d-model",
        "version": 1,
        "generator": "bench",
        "stage": "fine",
        "config": {"offsets": K, "feature_dim": F, "embedding_dim": E, "plane_dim": C, "levels": 2, "bins": B},
        "model_to_world": np.diag([50.0, 50.0, 50.0, 1.0]).tolist(),
        "fps": 24.0,
        "camera": {"model": "PINHOLE", "width": 320, "height": 180, "K": [[280, 0, 160], [0, 280, 90], [0, 0, 1]]},
        "frames": [
            {
                "name": f"{rank:06}",
                "image": f"frames/{rank:06}.png",
                "time_s": rank / 24,
                "t": rank / (FRAMES - 1),
                "split": "train" if rank % 8 else "test",
                "viewmat": view.tolist(),
            }
            for rank in range(FRAMES)
        ],
        "capture": None,
        "background": [0.5, 0.5, 0.5],
        "training": {"seconds": 0.0},
    }
    header: dict[str, Any] = {"__metadata__": {"aa4d": json.dumps(information)}}
    end = 0
    for name, tensor in tensors.items():
        header[name] = {"dtype": "F32", "shape": list(tensor.shape), "data_offsets": [end, end + tensor.nbytes]}
        end += tensor.nbytes
    text = json.dumps(header).encode()
    with path.open("wb") as file:
        file.write(struct.pack("<Q", len(text)) + text)
        for tensor in tensors.values():
            file.write(tensor.tobytes())


def best_ms(
    work: Callable[[int], object], repeats: int = REPEATS, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Milliseconds, by this clock, of the fastest of several calls; each is told its number."""
    times = []
    for number in range(repeats):
        start = clock()
        work(number)
        times.append(clock() - start)
    return 1000 * min(times)


@contextmanager
def extension(zip_path: Path) -> Iterator[str]:
    """The extension installed for this run; the name of its module."""
    with tempfile.TemporaryDirectory() as scratch:
        os.environ["BLENDER_USER_RESOURCES"] = scratch
        import bpy

        bpy.ops.wm.read_factory_settings(use_empty=True)
        folder = Path(scratch, "bench")
        folder.mkdir()
        preferences = bpy.ops.preferences
        preferences.extension_repo_add(
            type="LOCAL", name="aa4d_bench", use_custom_directory=True, custom_directory=str(folder)
        )
        repository = bpy.context.preferences.extensions.repos[-1].module
        bpy.ops.extensions.package_install_files(filepath=str(zip_path.resolve()), repo=repository)
        module = f"bl_ext.{repository}.adaanchor4d"
        preferences.addon_enable(module=module)
        try:
            yield module
        finally:
            preferences.addon_disable(module=module)


def measure(module: str, model_path: Path, carrier: str, folder: Path) -> dict[str, Any]:
    """One row of the table."""
    import bpy

    field, carriers, playback, points, knots = (
        importlib.import_module(f"{module}.{name}") for name in ("field", "carriers", "playback", "points", "knots")
    )
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    playback._load.cache_clear()
    start = time.perf_counter()
    bpy.ops.aa4d.import_model(filepath=str(model_path), carrier=carrier, set_up_scene=True)
    import_s = time.perf_counter() - start
    scene, obj = bpy.context.scene, bpy.context.active_object
    loaded = playback.loaded_of(obj)
    prepared, center = loaded.source.field, loaded.source.clip.camera_center_at(0.5)
    whole = carrier == "GAUSSIANS"
    wanted = playback.wanted_of(obj)
    state = field.anchor_state(prepared, 0.3, offsets=whole)
    decode = field.local_gaussians if whole else field.anchor_appearance
    values = carriers.evaluate(prepared, carrier, 0.3, center, wanted)

    def copy(_: int) -> None:
        for attribute, array in values.items():
            points.write(obj.data, attribute.name, attribute.type, array)
        obj.data.update()

    def play(number: int) -> None:
        scene.frame_set(1 + number % FRAMES)

    def play_anew(number: int) -> None:
        loaded.frames.clear()
        play(number + 1)

    row: dict[str, Any] = {
        "points": len(obj.data.vertices),
        "carrier": carrier.lower(),
        "import_s": import_s,
        "field_ms": best_ms(lambda n: field.anchor_state(prepared, 0.1 + 0.1 * n, offsets=whole)),
        "decode_ms": best_ms(lambda _: decode(prepared, state, center)),
        "copy_ms": best_ms(copy),
        "live_ms": best_ms(play_anew),
        "live_processor_ms": best_ms(play_anew, clock=time.process_time),
    }
    known = knots.Knots(knots.MOST_INTERVALS)
    for name, quick in (("exact", None), ("playing", known)):  # the evaluation alone, at times between two knots

        def evaluate(number: int, quick: Any = quick) -> Any:
            return carriers.evaluate(prepared, carrier, 0.51 + 0.001 * number, center, wanted, quick)

        row[f"{name}_ms"] = best_ms(evaluate, 2 * REPEATS)
        row[f"{name}_processor_ms"] = best_ms(evaluate, clock=time.process_time)
    for frame in range(FRAMES):
        play(frame)
    row["live_again_ms"] = best_ms(play, 2 * FRAMES)

    def bare(number: int) -> None:
        copy(number)
        play(number)

    obj.aa4d.playback = "BAKED"  # nobody evaluates: the same attributes, ready made
    row["bare_ms"] = best_ms(bare, FRAMES)
    row["bare_processor_ms"] = best_ms(bare, FRAMES, time.process_time)
    obj.aa4d.playback = "LIVE"
    start = time.perf_counter()
    bpy.ops.aa4d.bake()
    row["bake_s_a_frame"] = (time.perf_counter() - start) / FRAMES
    row["baked_ms"] = best_ms(play, 2 * FRAMES)
    row["baked_processor_ms"] = best_ms(play, 2 * FRAMES, time.process_time)
    blend = folder / "bench.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), compress=True)
    row["blend_mb_a_frame"] = blend.stat().st_size / FRAMES / 1e6
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 4, False, 0
    scene.render.filepath = str(folder / "bench.png")
    start = time.perf_counter()
    bpy.ops.render.render(write_still=True)
    row["cycles_s"] = time.perf_counter() - start
    return row


def accuracy(module: str, model_path: Path) -> list[dict[str, Any]]:
    """Bakes of a trained model with fewer or coarser keys against the exact evaluation, at every quarter of a frame."""
    field, carriers, names, model, knots = (
        importlib.import_module(f"{module}.{name}") for name in ("field", "carriers", "names", "model", "knots")
    )
    prepared = field.prepare(model.read_model(model_path))
    frames = prepared.model.frame_count
    center = prepared.model.camera_center_at(0.5)

    def evaluate(rank: float, known: Any = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        values = carriers.evaluate(prepared, names.ANCHORS, prepared.model.time_of_rank(rank), center, (), known)
        return values[names.POSITION], values[names.COLOR][:, :3], values[names.OPACITY]

    ranks = np.arange(4 * (frames - 1) + 1) / 4
    exact = {rank: evaluate(rank) for rank in ranks}
    seconds = best_ms(lambda n: evaluate(n + 0.1)) / 1000
    known = knots.of_clip(frames)
    played = {rank: evaluate(rank, known) for rank in ranks}
    rows = [_errors("live, while the timeline plays", 1 + (known.intervals if known else 0), exact, played)]
    for label, step, half in (
        ("keys every half frame", 0.5, False),
        ("keys every frame", 1, False),
        ("keys every 2 frames", 2, False),
        ("keys every 4 frames", 4, False),
        ("keys every frame, positions in half precision", 1, True),
    ):
        count = int(np.ceil((frames - 1) / step)) + 1
        spacing = (frames - 1) / (count - 1)
        keys = [evaluate(number * spacing) for number in range(count)]
        places = [key[0].astype(np.float16).astype(np.float32) if half else key[0] for key in keys]
        between = {}
        for rank in ranks:
            low = min(int(rank / spacing), count - 2)
            share = rank / spacing - low
            place = (1 - share) * places[low] + share * places[low + 1]
            between[rank] = place, (1 - share) * keys[low][1] + share * keys[low + 1][1]
        row = _errors(label, count, exact, between)
        rows.append(row | {"bake_s": count * seconds, "bytes_a_point_and_frame": count / frames * (14 if half else 20)})
    rows[0] |= {"bake_s": 0.0, "bytes_a_point_and_frame": 0.0}
    return rows


def _errors(
    label: str, keys: int, exact: Mapping[Any, tuple[Any, ...]], other: Mapping[Any, tuple[Any, ...]]
) -> dict[str, Any]:
    """How far places and colours of visible points are from the exact ones, over all ranks."""
    seen = {rank: values[2] >= 0.05 for rank, values in exact.items()}
    place = np.concatenate([np.linalg.norm(other[r][0] - exact[r][0], axis=1)[seen[r]] for r in exact])
    color = np.concatenate([np.abs(other[r][1] - exact[r][1]).max(axis=1)[seen[r]] for r in exact])
    return {
        "what": label,
        "keys": keys,
        "mean_mm": 1000 * float(place.mean()),
        "p99_mm": 1000 * float(np.percentile(place, 99)),
        "color_p99_of_255": 255 * float(np.percentile(color, 99)),
    }


def pictures(
    module: str, model_path: Path, folder: Path, scratch: Path, samples: int | None = None
) -> list[dict[str, Any]]:
    """Renders of the local Gaussians against the PNGs of `aa4d render`."""
    import bpy

    looks, playback = (importlib.import_module(f"{module}.{name}") for name in ("looks", "playback"))

    def read(path: Path) -> np.ndarray:
        image = bpy.data.images.load(str(path))
        image.colorspace_settings.name = "Non-Color"
        pixels = np.array(image.pixels[:], np.float32).reshape(-1, image.channels)[:, :3]
        bpy.data.images.remove(image)
        return pixels

    kinds = RENDERS if samples is None else dict.fromkeys(kind._replace(samples=samples) for kind in RENDERS)
    rows = []
    for kind in kinds:
        if kind.look not in looks.LOOKS:
            continue
        print(f"rendering {kind} ...", file=sys.stderr, flush=True)
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        bpy.ops.aa4d.import_model(
            filepath=str(model_path.resolve()),
            carrier="GAUSSIANS",
            look=kind.look,
            set_up_scene=True,
            trained_picture=kind.trained_picture,
            harmonics=kind.harmonics,
            background_frames=False,
            vehicles=False,
        )
        scene, obj = bpy.context.scene, bpy.context.active_object
        clip = playback.loaded_of(obj).source.clip
        obj.aa4d.frozen_view, obj.aa4d.view = clip.camera_centers.mean(axis=0), kind.seen_from
        scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = kind.samples, False, 0
        scene.cycles.use_adaptive_sampling = False
        decibels, seconds = [], []
        for rank, image in zip(clip.ranks.tolist(), clip.images, strict=True):
            target = folder / f"{Path(image).stem}.png"
            if not target.is_file():
                continue
            scene.frame_set(1 + int(rank), subframe=rank % 1)
            scene.render.filepath = str(scratch / "picture.png")
            start = time.process_time()
            bpy.ops.render.render(write_still=True)
            seconds.append(time.process_time() - start)
            error = np.mean((read(Path(scene.render.filepath)) - read(target)) ** 2)
            decibels.append(-10 * float(np.log10(error)))
        if not decibels:
            raise SystemExit(f"{folder} has no picture of a frame of {model_path.name}, such as {target.name}")
        row = kind._asdict() | {"trained_picture": "yes" if kind.trained_picture else "no", "frames": len(decibels)}
        row["seen_from"] = kind.seen_from.lower()
        rows.append(row | {"db": float(np.mean(decibels)), "processor_s": float(np.mean(seconds))})
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """Rows as Markdown."""
    cells = [list(rows[0])]
    cells += [[f"{v:.3g}" if isinstance(v, float) else str(v) for v in row.values()] for row in rows]
    lines = ["| " + " | ".join(line) + " |" for line in cells]
    return "\n".join([lines[0], "|" + "---|" * len(cells[0]), *lines[1:]])


def write(path: Path, value: Any) -> None:
    """Write JSON whole or not at all."""
    partial = path.with_name(f".{path.name}.part")
    try:
        partial.write_text(json.dumps(value, indent=1))
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="bench_addon.py", description="Measure the AdaAnchor4D extension.")
    parser.add_argument("--extension", type=Path, required=True, help="the zip that build_extension.py wrote")
    parser.add_argument("--json", type=Path, required=True, help="where to write the rows")
    parser.add_argument("--model", type=Path, help="a trained model, for accuracy against time")
    parser.add_argument("--pictures", type=Path, help="a folder of PNGs that aa4d render wrote of this model")
    parser.add_argument("--samples", type=int, help="of every render; by default each row has its own")
    parser.add_argument("--anchors", type=int, nargs="*", default=ANCHORS, help="how many anchors the models have")
    options = parser.parse_args()
    result: dict[str, Any] = {"load_before": os.getloadavg(), "cpus": os.cpu_count(), "rows": []}
    with tempfile.TemporaryDirectory() as scratch, extension(options.extension) as module:
        import bpy

        result["blender"] = bpy.app.version_string
        for anchors in options.anchors:
            path = Path(scratch, f"{anchors}.safetensors")
            random_model(path, anchors)
            for carrier in ("ANCHORS", "GAUSSIANS"):
                print(f"measuring {anchors:,} anchors as {carrier.lower()} ...", file=sys.stderr, flush=True)
                result["rows"].append(measure(module, path, carrier, Path(scratch)))
        if options.model is not None:
            result["accuracy"] = accuracy(module, options.model)
            if options.pictures is not None:
                folder = options.pictures
                result["pictures"] = pictures(module, options.model, folder, Path(scratch), options.samples)
    options.json.parent.mkdir(parents=True, exist_ok=True)
    write(options.json, result)
    if "pictures" in result:
        write(options.json.with_stem(f"{options.json.stem}-pictures"), result["pictures"])
    for rows in (result["rows"], result.get("accuracy"), result.get("pictures")):
        if rows:
            print(f"{table(rows)}\n")
    print(f"Blender {result['blender']}, {os.cpu_count()} CPUs, load before {result['load_before'][0]:.1f}")
    print(f"Rows: {options.json}")
    return 0


if __name__ == "__main__":
    code = main()
    if "bpy" in sys.modules:
        shutil.rmtree(sys.modules["bpy"].app.tempdir, ignore_errors=True)  # only Blender's own exit would
    sys.stdout.flush()
    os._exit(code)  # Blender 4.5 as a module can hang in its own exit
