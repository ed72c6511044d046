"""Where to start the search for a focal length that nobody states.

Bundle adjustment ends in the minimum that is nearest to where it starts, and a wrong field of view can be one. So a
part of the clip is mapped from several starts, and by COLMAP's global mapper, which estimates the focal length from the
two-view geometries first; the start that explains the frames best is the whole clip's.
"""

from __future__ import annotations

import math
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pycolmap

from aa4d.capture.colmap import TO_GO_ON_BYTES, check_space
from aa4d.capture.settings import Reconstruction

STARTS_DEG = (30.0, 45.0, 75.0, 95.0)  # fields of view across the longest side; the usual guess comes before them
MOST_PROBED = 24  # frames: enough to see around things, few enough to be mapped several times
SPREAD_OVER = 10  # frames at least, where the clip has them
FEWEST_PROBED = 3  # frames: with fewer there is no model
GLOBAL = "global mapper"
HELD = "held"
FREED = "freed"
NEARLY_ALL = 0.9  # share of the frames that the most successful try has placed
AGREEMENT = 0.05  # share by which fields of view may differ, and errors, to be the same
CLEARLY = 0.8  # share of the error with the stated field of view: another one that is below it is better
GLOBAL_TIMEOUT_S = 600.0
# For a process of its own: COLMAP's checks end the process that they fail in.
GLOBALLY = """
import sys
import pycolmap
from aa4d.capture.colmap import quiet
quiet()
database, images, folder, seed, threads, *names = sys.argv[1:]
options = pycolmap.GlobalPipelineOptions()
options.random_seed = options.mapper.random_seed = int(seed)
options.num_threads = options.mapper.num_threads = int(threads)
options.image_names = names
pycolmap.set_random_seed(int(seed))
pycolmap.global_mapping(database, images, folder, options)
"""


@dataclass(frozen=True)
class Tried:
    """What a part of the clip came to from one start."""

    start: str  # in words
    fov_deg: float  # that was found, horizontal
    frames: int  # that were placed
    error_px: float  # mean of the observations

    def __str__(self) -> str:
        return f"{self.start}: {self.fov_deg:.0f} degrees, {self.frames} frames, {self.error_px:.2f} px"


@dataclass(frozen=True)
class Start:
    """The database to map the whole clip from: the one that was given, or a copy with another focal length."""

    database: Path
    tried: tuple[Tried, ...] = ()
    probed: int = 0  # frames
    chosen: int = 0  # of `tried`

    def notes(self) -> list[str]:
        """Where another start than the usual one was better, what all of them came to."""
        if self.chosen == 0:
            return []
        said = "; ".join(str(t) for t in self.tried)
        used = self.tried[self.chosen].start
        return [f"fields of view that {self.probed} frames were mapped from: {said}; used is what {used} found"]


def find_start(
    database: Path,
    images: Path,
    names: list[str],
    settings: Reconstruction,
    seed: int,
    threads: int,
    folder: Path,
    map_part: Callable[[Path, list[str], Path], Any],
    has_usual_focal: Callable[[Any], bool],
) -> Start:
    """Try the usual start and the global mapper on a part of the clip, and where they do not agree, further ones.

    Args:
        names: of the frames, in order.
        map_part: maps the frames of those names from a database, in a folder; None where it finds nothing.
        has_usual_focal: whether a model's field of view is one that cameras have: others are no candidates.
    """
    with pycolmap.Database.open(database) as opened:
        camera = opened.read_all_cameras()[0]
    part = probed_frames(names, settings.window)
    if camera.has_prior_focal_length or len(part) < FEWEST_PROBED:
        return Start(database)
    usual = f"{field_of_view_deg(camera.width, camera.mean_focal_length()):.0f} degrees"
    tried: list[Tried] = []
    models: list[Any] = []

    def keep(start: str, model: Any) -> None:
        if model is not None and has_usual_focal(model):
            tried.append(as_tried(start, model))
            models.append(model)

    keep(usual, map_part(database, part, folder / "start-usual"))
    keep(GLOBAL, map_globally(database, images, part, seed, threads, folder / "start-global"))
    if len(tried) < 2 or not _agree(*tried):
        for degrees in STARTS_DEG:
            focal_px = 0.5 * max(camera.width, camera.height) / math.tan(math.radians(degrees) / 2)
            tries = folder / f"start-{degrees:.0f}"
            model = map_part(with_focal(database, focal_px, tries.with_suffix(".db")), part, tries)
            keep(f"{field_of_view_deg(camera.width, focal_px):.0f} degrees", model)
    if not tried:
        return Start(database)
    chosen = best_of(tried)
    if tried[chosen].start == usual:
        return Start(database, tuple(tried), len(part), chosen)
    focal_px = next(iter(models[chosen].cameras.values())).mean_focal_length()
    return Start(with_focal(database, focal_px, folder / "start.db"), tuple(tried), len(part), chosen)


def probed_frames(names: list[str], window: int) -> list[str]:
    """Frames of the middle of the clip, at most the window apart: such pairs are matched, and twice as far too."""
    spread = names[:: max(min(window, len(names) // SPREAD_OVER), 1)]
    first = max((len(spread) - MOST_PROBED) // 2, 0)
    return spread[first : first + MOST_PROBED]


def best_of(tried: list[Tried]) -> int:
    """The lowest error among those that placed nearly as many frames as any; the first where others are no better."""
    most = max(t.frames for t in tried)
    candidates = [i for i, t in enumerate(tried) if t.frames >= NEARLY_ALL * most]
    least = min(tried[i].error_px for i in candidates)
    return next(i for i in candidates if tried[i].error_px <= (1 + AGREEMENT) * least)


def rivals(tried: tuple[Tried, ...], chosen: int) -> list[Tried]:
    """Other fields of view that explain the frames about as well as the chosen one."""
    if not tried:
        return []
    one = tried[chosen]
    return [
        t
        for t in tried
        if abs(t.fov_deg / one.fov_deg - 1) > 2 * AGREEMENT
        and t.frames >= NEARLY_ALL * one.frames
        and t.error_px <= (1 + 2 * AGREEMENT) * one.error_px
    ]


def held_and_freed(model: Any, threads: int) -> tuple[Tried, Tried]:
    """A model that was mapped with a stated focal length, and what bundle adjustment finds once that is free."""
    copy, whole = pycolmap.Reconstruction(model), pycolmap.BundleAdjustmentConfig()
    for image in copy.reg_image_ids():
        whole.add_image(image)
    whole.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = options.refine_extra_params = True
    options.print_summary = False
    options.ceres.solver_options.num_threads = threads
    # Not pycolmap.bundle_adjustment, which writes to COLMAP's log and turns that on for good.
    pycolmap.create_default_bundle_adjuster(options, whole, copy).solve()
    copy.update_point_3d_errors()
    return as_tried(HELD, model), as_tried(FREED, copy)


def contradicts(held: Tried, freed: Tried) -> bool:
    """Whether the frames say clearly that another field of view than the stated one is theirs."""
    return abs(freed.fov_deg / held.fov_deg - 1) > 2 * AGREEMENT and freed.error_px <= CLEARLY * held.error_px


def as_tried(start: str, model: Any) -> Tried:
    error, camera = float(model.compute_mean_reprojection_error()), next(iter(model.cameras.values()))
    return Tried(start, field_of_view_deg(camera.width, camera.mean_focal_length()), model.num_reg_images(), error)


def _agree(one: Tried, other: Tried) -> bool:
    return (
        abs(one.fov_deg / other.fov_deg - 1) <= AGREEMENT
        and min(one.frames, other.frames) >= NEARLY_ALL * max(one.frames, other.frames)
        and one.error_px <= 2 * other.error_px
    )


def map_globally(database: Path, images: Path, names: list[str], seed: int, threads: int, folder: Path) -> Any:
    """The largest model of COLMAP's global mapper; None where it finds none, or fails. OSError: the disk is full."""
    folder.mkdir(parents=True, exist_ok=True)
    copy = folder / "database.db"  # it writes the focal length that it estimates
    shutil.copyfile(database, copy)
    arguments = [str(copy), str(images), str(folder), str(seed), str(threads), *names]
    try:
        ended = subprocess.run(
            [sys.executable, "-c", GLOBALLY, *arguments], capture_output=True, timeout=GLOBAL_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return None
    found = [path.parent for path in folder.glob("*/images.bin")]
    if ended.returncode or not found:
        check_space(folder, TO_GO_ON_BYTES)  # a full disk is no verdict on the footage
        return None
    models = [pycolmap.Reconstruction(path) for path in found]
    largest = max(models, key=lambda model: model.num_reg_images())
    return largest if largest.num_reg_images() and largest.num_points3D() else None


def with_focal(database: Path, focal_px: float, target: Path) -> Path:
    """A copy of a database whose only camera begins with another focal length."""
    shutil.copyfile(database, target)
    with pycolmap.Database.open(target) as opened:
        camera = opened.read_all_cameras()[0]
        parameters = list(camera.params)
        for index in camera.focal_length_idxs():
            parameters[index] = focal_px
        camera.params = parameters
        opened.update_camera(camera)
    return target


def field_of_view_deg(width: int, focal_px: float) -> float:
    """Horizontal field of view in degrees, of pictures `width` pixels wide with a focal length in pixels."""
    return math.degrees(2 * math.atan(0.5 * width / focal_px))
