"""What accuracy costs in time, measured on one scene in one run.

python synth/cost.py scenes/tiny.toml --out costs          (with the bpy module)
aa4d synth cost scenes/tiny.toml --out costs               (and a plot)
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

HOME = Path(__file__).resolve().parent
sys.path[:] = [str(HOME.parent), *(entry for entry in sys.path if Path(entry).resolve() != HOME)]

from synth import effects  # noqa: E402
from synth.capture import Folder  # noqa: E402
from synth.costs import Costs  # noqa: E402
from synth.errors import InputError  # noqa: E402
from synth.files import write_json  # noqa: E402
from synth.interrupts import interrupt_deferred  # noqa: E402
from synth.leaving import exit_code, leave, own_arguments  # noqa: E402
from synth.parent import end_with_parent  # noqa: E402
from synth.plan import Frame, Plan, make_fleet, make_plan  # noqa: E402
from synth.progress import Progress  # noqa: E402
from synth.spec import Scene, read_scene  # noqa: E402

SAMPLES = (1, 4, 16, 64)
SEEDS = 3  # renders of one instant, whose spread is the flicker
BLUR_STEPS, BLUR_REFERENCE = (1, 2, 3), 5
TRAFFIC_STEPS_S, TRAFFIC_REFERENCE_S = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01), 0.001

Row = dict[str, Any]


def psnr(image: np.ndarray, reference: np.ndarray) -> float:
    """Of 8-bit images, in dB; 99 where they are equal."""
    error = float(np.mean((image.astype(np.float64) - reference) ** 2))
    return float(10 * np.log10(255**2 / error)) if error > 0 else 99.0


def clocks() -> np.ndarray:
    """Seconds of the clock and of the processor, all threads; differences mean something."""
    return np.array([time.perf_counter(), time.process_time()])


def spent(seconds: np.ndarray) -> Row:
    """Both clocks as entries of a row."""
    return {"seconds": float(seconds[0]), "processor_s": float(seconds[1])}


class Studio:
    """A scene built in Blender, with a stopwatch; `home` is where the files that it names are looked up."""

    def __init__(self, scene: Scene, home: Path, scratch: Path) -> None:
        from synth.blender.film import Filming

        self.plan: Plan = make_plan(scene, home)
        self.costs = Costs(None)
        self.folder = Folder(scratch)
        with self.costs.stage("build"):
            self.filming = Filming(self.plan, self.folder, self.costs, scratch)

    def frame(self, seed: int | None = None) -> Frame:
        """The frame in the middle of the clip, rendered with another seed if one is given."""
        middle = self.plan.frames[len(self.plan.frames) // 2]
        return middle if seed is None else replace(middle, seed=seed)

    def picture(self, seed: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """The 8-bit frame and its seconds by both clocks, loading of the geometry left out."""
        from synth.blender.passes import linear_rgb
        from synth.develop import srgb_from_linear

        frame = self.frame(seed)
        self.filming.place(frame)
        if not self.plan.shutter.instant:
            from synth.blender.motion import animate

            animate(self.plan, frame, self.filming.stage, self.filming.extras)
        start = clocks()
        linear = linear_rgb(self.filming.renderer.render_picture(frame.seed))
        return srgb_from_linear(linear), clocks() - start


def with_render(scene: Scene, samples: int, denoise: bool) -> Scene:
    return replace(scene, render=replace(scene.render, samples=samples, denoise=denoise), effects={})


def render_rows(scene: Scene, home: Path, reference_samples: int, scratch: Path, step: Callable[[], None]) -> list[Row]:
    """Samples and denoising against a picture of many samples."""
    reference, seconds = Studio(with_render(scene, reference_samples, False), home, scratch).picture()
    step()
    rows: list[Row] = [{"samples": reference_samples, "denoise": False, **spent(seconds), "reference": True}]
    for denoise in (False, True):
        for samples in SAMPLES:
            studio = Studio(with_render(scene, samples, denoise), home, scratch)
            studio.picture()  # loads the geometry
            taken = [studio.picture(seed) for seed in range(1, SEEDS + 1)]
            images = np.stack([image for image, _ in taken]).astype(np.float64)
            rows.append({
                "samples": samples, "denoise": denoise, **spent(np.min([s for _, s in taken], axis=0)),
                "psnr_db": float(np.mean([psnr(image, reference) for image in images])),
                "flicker": float(images.std(axis=0, ddof=1).mean()),
            })  # fmt: skip
            step()
    return rows


def blur_rows(scene: Scene, home: Path, scratch: Path, step: Callable[[], None]) -> list[Row]:
    """Straight pieces of motion against many, at the scene's exposure or half a frame."""
    exposure = scene.effects.get("motion_blur", {}).get("exposure_s", 0.5 / scene.time.fps)

    def shoot(pieces: int) -> tuple[np.ndarray, np.ndarray]:
        table = {"motion_blur": {"exposure_s": exposure, "steps": pieces}}
        studio = Studio(replace(with_render(scene, 64, False), effects=table), home, scratch)
        studio.picture()
        step()
        return studio.picture()

    reference, _ = shoot(BLUR_REFERENCE)
    rows = []
    for pieces in BLUR_STEPS:
        image, seconds = shoot(pieces)
        rows.append({"steps": pieces, "exposure_s": exposure, **spent(seconds), "psnr_db": psnr(image, reference)})
    return rows


def traffic_rows(scene: Scene, home: Path, step: Callable[[], None]) -> list[Row]:
    """Step sizes of the traffic simulation against a fine one."""
    duration = max((scene.time.frames - 1) / scene.time.fps, 1.0)
    times = np.linspace(0, duration, 51)

    def positions(step_s: float) -> tuple[np.ndarray, np.ndarray]:
        start = clocks()
        fleet = make_fleet(replace(scene, traffic=replace(scene.traffic, step_s=step_s)), duration, home)
        seconds = clocks() - start
        return np.stack([fleet.object_to_world(float(t))[:, :2, 3] for t in times]), seconds

    reference, _ = positions(TRAFFIC_REFERENCE_S)
    step()
    rows: list[Row] = []
    for step_s in TRAFFIC_STEPS_S:
        try:
            found, seconds = positions(step_s)
        except InputError as error:  # so coarse that vehicles run into each other
            rows.append({"step_s": step_s, "refused": str(error)})
        else:
            off = np.linalg.norm(found - reference, axis=-1)
            worst, mean = (float(off.max()), float(off.mean())) if off.size else (0.0, 0.0)
            rows.append({"step_s": step_s, **spent(seconds), "worst_m": worst, "mean_m": mean})
        step()
    return rows


def effect_rows(scene: Scene, home: Path, scratch: Path, step: Callable[[], None]) -> list[Row]:
    """Seconds of one frame with each effect alone, with the scene's settings or the effect's own, and without any."""
    from synth.blender.video import through_video

    def shoot(table: dict[str, Any], folder: Path) -> tuple[dict[str, float], Studio]:
        studio = Studio(replace(scene, effects=table), home, folder)
        frame = studio.frame()
        seconds = {"build": studio.costs.stages["build"]}
        for name, film in (("truth", studio.filming.film_truth), ("picture", studio.filming.film_picture)):
            for _ in range(2):  # the first loads the geometry
                start = clocks()
                film(frame)
                for key, taken in zip((name, f"{name}_processor_s"), clocks() - start, strict=True):
                    seconds[key] = min(seconds.get(key, np.inf), float(taken))
        step()
        return seconds, studio

    off, _ = shoot({}, scratch / "off")
    rows: list[Row] = [{"effect": "none", **off}]
    for name in effects.NAMES:
        table = {name: scene.effects.get(name, {})}
        try:
            on, studio = shoot(table, scratch / name)
        except InputError as error:
            rows.append({"effect": name, "refused": str(error)})
            step()
            continue
        if studio.plan.effects[0].stage == "encode":
            settings, frame = studio.plan.effects[0].settings, studio.folder.developed(studio.frame())
            start = time.perf_counter()
            through_video([frame], [scratch / "decoded.png"], scratch / "video.mp4", scene.time.fps,
                          (settings.codec, settings.bitrate_kbps, settings.keyframe_every))  # fmt: skip
            on["encode"] = time.perf_counter() - start
        rows.append({"effect": name, "stage": studio.plan.effects[0].stage, **on})
    return rows


def measure(scene: Scene, home: Path, reference_samples: int) -> dict[str, Any]:
    """All four tables; `home` is where the files that the scene names are looked up."""
    from synth.blender.session import version

    total = 1 + 2 * len(SAMPLES) + 1 + len(BLUR_STEPS) + 1 + len(TRAFFIC_STEPS_S) + 1 + len(effects.NAMES)
    step = Progress("measurement", total).advance
    with tempfile.TemporaryDirectory(prefix="aa4d-cost-") as name:
        scratch = Path(name)
        return {
            "scene": scene.name,
            "size": [scene.camera.width_px, scene.camera.height_px],
            "blender": version(),
            "processors": os.cpu_count(),
            "load_before": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
            "render": render_rows(scene, home, reference_samples, scratch, step),
            "motion_blur": blur_rows(scene, home, scratch, step),
            "traffic": traffic_rows(scene, home, step),
            "effects": effect_rows(scene, home, scratch, step),
        }


def table(found: dict[str, Any]) -> str:
    """The tables for a terminal; times in seconds."""
    size = f"{found['size'][0]}x{found['size'][1]}"
    machine = f"{found['processors']} processors, load {found['load_before']}"
    lines = [f"{found['scene']}, {size}, Blender {found['blender']}, {machine}"]
    for key, title in (
        ("render", "samples and denoising, one frame"),
        ("motion_blur", "pieces of motion (2^steps), one frame"),
        ("traffic", "step of the traffic simulation, whole clip"),
        ("effects", "each effect alone, one frame"),
    ):
        columns = list(dict.fromkeys(name for row in found[key] for name in row))
        widths = [max(len(name), *(len(_text(row.get(name))) for row in found[key])) for name in columns]
        lines += ["", title, "  ".join(name.rjust(width) for name, width in zip(columns, widths, strict=True))]
        for row in found[key]:
            cells = zip(columns, widths, strict=True)
            lines.append("  ".join(_text(row.get(name)).rjust(width) for name, width in cells))
    return "\n".join(lines)


def _text(value: Any) -> str:
    return "" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def main(arguments: Sequence[str]) -> None:
    """Run the command line; raises InputError."""
    parser = argparse.ArgumentParser(prog="cost", description=__doc__.split("\n", 1)[0])
    parser.add_argument("scene", type=Path, metavar="SCENE")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where cost.json is written")
    parser.add_argument("--reference", type=int, default=256, metavar="N", help="samples of the reference picture")
    end_with_parent()
    options = parser.parse_args(arguments)
    scene = read_scene(options.scene)
    with interrupt_deferred():
        from synth.blender.session import silence
    silence()
    found = measure(scene, options.scene.parent, options.reference)
    write_json(options.out / "cost.json", found)
    print(table(found))
    print(options.out / "cost.json")


if __name__ == "__main__":
    leave(exit_code(lambda: main(own_arguments()), "; nothing is written"))
