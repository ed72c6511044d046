"""Incremental structure from motion (COLMAP), and the choice among the models that it finds."""

from __future__ import annotations

import shutil
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from aa4d.capture.advice import NOTHING_RECONSTRUCTED, no_model_advice
from aa4d.capture.beginning import FLAT_SHARE, LEAST_ANGLE_DEG, Pair, beginnings, begun
from aa4d.capture.clip import Clip
from aa4d.capture.colmap import is_whole_model, quiet, run, write_model
from aa4d.capture.focal import NEARLY_ALL, Start, Tried, as_tried, best_of, find_start, held_and_freed
from aa4d.capture.matching import Matches
from aa4d.capture.selection import abbreviate
from aa4d.capture.settings import CaptureSettings, Reconstruction
from aa4d.capture.workspace import Progress, Step, StepResult
from aa4d.errors import InputError

MIN_FRAMES = 3  # with fewer, a model is not worth keeping
MIN_POINTS = 30
MIN_REGISTERED_FRACTION = 0.5  # fraction of the frames: with less, mapping is tried again with the relaxed thresholds
OWN_CHOICE = "COLMAP's own choice"
RICH_SHARE = 0.25  # Share of the richest model's observations: with less, a low error says little
PARALLAX_DEG = 0.5  # median angle under which a point is seen; less is a camera that only turns


@dataclass(frozen=True)
class Attempt:
    """Thresholds of one try, from COLMAP's own to what a slow, high drone needs."""

    initial_angle_deg: float
    initial_inliers: int
    pose_inliers: int
    point_angle_deg: float


ATTEMPTS = (Attempt(16, 100, 30, 1.5), Attempt(4, 50, 20, 0.7), Attempt(1.5, 30, 15, 0.3))
# Fractions of the longest side: 100 to 14 degrees across. Over flat ground, a wrong focal length explains the frames as
# well as the right one; where what is found lies outside, the guess is kept instead.
MIN_FOCAL, MAX_FOCAL = 0.42, 4.0


@dataclass(frozen=True)
class Begun:
    """Models that mapping made, begun from a pair of frames."""

    pair: Pair | None  # None: COLMAP's own choice
    models: dict[int, Any]

    @property
    def has_usual_focal(self) -> bool:
        return any(has_usual_focal(model) for model in self.models.values())

    @property
    def observations(self) -> int:
        return int(_largest(self.models).compute_num_observations())

    def tried(self, clip: Clip) -> Tried:
        labels = {frame.file: frame.label for frame in clip.frames}
        name = OWN_CHOICE if self.pair is None else " and ".join(labels[file] for file in self.pair.files)
        return as_tried(name, _largest(self.models))


@dataclass(frozen=True)
class Cameras(StepResult):
    """A COLMAP model of the clip's frames. Frames are named by their ranks in the clip."""

    registered: tuple[int, ...]  # those with a pose
    other_models: tuple[list[int], ...]  # ranks in models that could not be joined with this one
    attempts: int  # number of ATTEMPTS made; 0 where the cameras were given
    focal_was_kept: bool  # the guess, as the frames gave an impossible one
    median_angle_deg: float  # the widest under which a point is seen
    tried: tuple[dict[str, Any], ...] = ()  # `Tried` of each start of the focal length, on a part of the clip
    probed: int = 0  # frames of that part
    chosen: int = 0  # of `tried`, whose focal length the whole clip was mapped from
    freed: tuple[dict[str, Any], ...] = ()  # `Tried` of a stated focal length, and of the same model with that free
    begun_from: tuple[dict[str, Any], ...] = ()  # `Tried` of each pair that mapping began with, the one used first

    @property
    def start(self) -> Start:
        return Start(self.folder, tuple(Tried(**values) for values in self.tried), self.probed, self.chosen)

    def is_whole(self) -> bool:
        return is_whole_model(self.folder / "model")

    def read(self) -> Any:
        """A pycolmap.Reconstruction."""
        return pycolmap.Reconstruction(self.folder / "model")

    def notes(self, clip: Clip) -> list[str]:
        """Notes on what the model leaves out: frames without a pose, and the other models."""
        said = self.start.notes()
        if len(self.begun_from) > 1 and self.begun_from[0]["start"] != OWN_CHOICE:
            tried = "; ".join(str(Tried(**values)) for values in self.begun_from)
            said.append(f"most pairs of frames show one plane: mapping began with {tried}; used is the first")
        if self.attempts > 1:
            a = ATTEMPTS[self.attempts - 1]
            said.append(
                f"the cameras were found at attempt {self.attempts} of {len(ATTEMPTS)}, which begins with a pair that "
                f"sees {a.initial_inliers} points under {a.initial_angle_deg:g} degrees: depths are less certain"
            )
        for ranks in self.other_models:
            first, last = clip.frames[ranks[0]], clip.frames[ranks[-1]]
            said.append(
                f"a second part of the clip, {len(ranks)} frames from {first.label} to {last.label}, could not be "
                "joined with the largest and was left out"
            )
        elsewhere = {rank for ranks in self.other_models for rank in ranks}
        lost = sorted(set(range(len(clip.frames))) - set(self.registered) - elsewhere)
        if lost:
            said.append(f"{abbreviate([clip.frames[i].label for i in lost])} left out: no pose could be found")
        return said


def solve_step(clip: Clip, matches: Matches, settings: CaptureSettings) -> Step[Cameras]:
    """Find cameras of which nothing is known but, perhaps, the field of view."""
    how = settings.reconstruction
    return Step(
        "cameras",
        [how.global_refinements, how.grown_by, settings.seed, FLAT_SHARE],
        lambda *place: reconstruct(clip, matches, settings, *place),
        Cameras,
    )


def triangulate_step(clip: Clip, given: Any, matches: Matches) -> Step[Cameras]:
    """Find points for the cameras of `given`, a pycolmap.Reconstruction."""
    return Step("cameras", ["triangulate"], lambda *place: triangulate(clip, given, matches.database, *place), Cameras)


def adopt_step(clip: Clip, given: Any) -> Step[Cameras]:
    """Take cameras and points from `given`, a pycolmap.Reconstruction."""
    return Step("cameras", ["given"], lambda folder, _: adopt(clip, given, folder), Cameras)


def reconstruct(clip: Clip, matches: Matches, settings: CaptureSettings, folder: Path, progress: Progress) -> Cameras:
    """Write the largest model into `folder`/model.

    Raises:
        InputError: nothing could be reconstructed; says what the frames lack and what to do.
    """
    how, threads, seed = settings.reconstruction, settings.threads, settings.seed
    focal_is_known = settings.fov_deg is not None
    database, geometry = matches.database, matches.geometry
    best: dict[int, Any] = {}
    begun_from: tuple[Tried, ...] = ()
    number, solve_focal = 0, not focal_is_known
    names = [frame.file for frame in clip.frames]

    def map_part(database: Path, part: list[str], tries: Path) -> Any:
        tries.mkdir()
        best: dict[int, Any] = {}
        for pair in beginnings(database, part):
            options = _options(how, ATTEMPTS[0], True, threads, seed, pair)
            options.image_names = part
            models = _map(clip, database, options, pair, tries, progress)
            if _registered(models) > _registered(best):
                best = models
            if _registered(best) >= NEARLY_ALL * len(part):
                break
        return _largest(best) if best else None

    def map_all(attempt: Attempt, solve_focal: bool, tries: Path) -> list[Begun]:
        found, matched = [], start.database if solve_focal else database
        for pair in reversed(beginnings(matched, names)):
            options = _options(how, attempt, solve_focal, threads, seed, pair)
            models = _map(clip, matched, options, pair, tries, progress)
            found += [Begun(pair, models)] if models else []
        return found

    probes = _emptied(folder / "starts")
    start = Start(database)
    if solve_focal:
        start = find_start(database, clip.folder, names, how, seed, threads, probes, map_part, has_usual_focal)
    for number, attempt in enumerate(ATTEMPTS):
        tries = _emptied(folder / f"attempt-{number}")
        found = map_all(attempt, solve_focal, tries)
        if solve_focal and found and not any(one.has_usual_focal for one in found):
            solve_focal = False
            found = map_all(attempt, solve_focal, tries)
        if not found:
            continue
        chosen = _best(found, solve_focal, clip)
        if _registered(chosen.models) > _registered(best):
            best = chosen.models
            begun_from = tuple(one.tried(clip) for one in sorted(found, key=lambda one: one is not chosen))
        if _registered(best) >= MIN_REGISTERED_FRACTION * len(names):
            break
    if not best:
        raise InputError(f"{NOTHING_RECONSTRUCTED}: {no_model_advice(geometry, focal_is_known)}")
    ordered = sorted(best.values(), key=lambda m: (-m.num_reg_images(), -m.num_points3D()))
    model = ordered[0]
    angles = triangulation_angles_deg(model)
    if float(np.median(angles)) < PARALLAX_DEG:
        raise InputError(f"{NOTHING_RECONSTRUCTED}: {no_model_advice({'PANORAMIC': 1}, focal_is_known)}")
    target = folder / "model"
    write_model(model, target)
    freed = held_and_freed(model, threads) if focal_is_known else ()
    for tries in (probes, *folder.glob("attempt-*")):
        shutil.rmtree(tries)
    registered = _ranks(model, names)
    # Models may overlap: what counts of the others are the frames that the largest has not.
    others = [sorted(set(_ranks(m, names)) - set(registered)) for m in ordered[1:]]
    return Cameras(
        folder,
        registered=tuple(registered),
        other_models=tuple(ranks for ranks in others if len(ranks) >= MIN_FRAMES),
        attempts=number + 1,
        focal_was_kept=not solve_focal and not focal_is_known,
        median_angle_deg=float(np.median(angles)),
        tried=tuple(asdict(t) for t in start.tried),
        probed=start.probed,
        chosen=start.chosen,
        freed=tuple(asdict(t) for t in freed),
        begun_from=tuple(asdict(t) for t in begun_from),
    )


def _emptied(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    return folder


def _options(
    settings: Reconstruction, attempt: Attempt, solve_focal: bool, threads: int, seed: int, pair: Pair | None
) -> Any:
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = threads
    options.random_seed = seed
    options.mapper.random_seed = seed
    options.triangulation.random_seed = seed
    options.min_model_size = MIN_FRAMES
    options.ba_refine_focal_length = options.mapper.abs_pose_refine_focal_length = solve_focal
    options.ba_global_max_refinements = settings.global_refinements
    options.ba_global_frames_ratio = options.ba_global_points_ratio = settings.grown_by
    options.mapper.init_min_tri_angle = attempt.initial_angle_deg
    options.mapper.init_min_num_inliers = attempt.initial_inliers
    options.mapper.abs_pose_min_num_inliers = attempt.pose_inliers
    angle_deg = attempt.point_angle_deg if pair is None else min(LEAST_ANGLE_DEG, attempt.point_angle_deg)
    options.mapper.filter_min_tri_angle = options.triangulation.min_angle = angle_deg
    return options


def _map(
    clip: Clip, matches: Path, options: Any, pair: Pair | None, folder: Path, progress: Progress
) -> dict[int, Any]:
    """Models by COLMAP's numbers for them, begun with `pair` or, where that is None, with the pair that it chooses."""
    registered = [0]

    def next_image() -> None:
        registered[0] += 1

    # The random numbers of RANSAC are drawn from one generator for all of COLMAP.
    pycolmap.set_random_seed(max(options.random_seed, 0))
    first = ""
    if pair is not None:
        first = str(_emptied(folder / "begun"))
        two = run(
            lambda token: pycolmap.triangulate_points(
                begun(pair, matches), matches, clip.folder, first, options=options, cancellation_token=token
            ),
            folder,
        )
        if two.num_points3D() < MIN_POINTS:
            return {}
        write_model(two, Path(first))
    found: dict[int, Any] = run(
        lambda token: pycolmap.incremental_mapping(
            matches,
            clip.folder,
            folder,
            options,
            input_path=first,
            next_image_callback=next_image,
            cancellation_token=token,
        ),
        folder,
        lambda: progress(min(registered[0] + 2 if registered[0] else 0, len(clip.frames)), len(clip.frames)),
    )
    return {i: model for i, model in found.items() if model.num_reg_images() >= MIN_FRAMES}


def has_usual_focal(model: Any) -> bool:
    """True where the field of view is one that cameras have."""
    return all(
        MIN_FOCAL <= camera.mean_focal_length() / max(camera.width, camera.height) <= MAX_FOCAL
        for camera in model.cameras.values()
    )


def _best(found: list[Begun], solve_focal: bool, clip: Clip) -> Begun:
    """The first of those that are no worse than any: a low error of few observations says little."""
    possible = [one for one in found if one.has_usual_focal or not solve_focal]
    enough = RICH_SHARE * max(one.observations for one in possible)
    rich = [one for one in possible if one.observations >= enough]
    return rich[best_of([one.tried(clip) for one in rich])]


def _largest(models: dict[int, Any]) -> Any:
    return max(models.values(), key=lambda m: m.num_reg_images())


def _registered(models: dict[int, Any]) -> int:
    return _largest(models).num_reg_images() if models else 0


def _ranks(model: Any, names: list[str]) -> list[int]:
    return sorted(names.index(model.image(i).name) for i in model.reg_image_ids())


def triangulation_angles_deg(model: Any) -> np.ndarray:
    """The widest angle [P] under which each point is seen, from at most ten of its frames."""
    centers = {i: model.image(i).projection_center() for i in model.reg_image_ids()}
    angles = []
    for point in model.points3D.values():
        ids = list({element.image_id for element in point.track.elements})
        chosen = np.array([centers[i] for i in ids[:: max(1, len(ids) // 10)]])
        rays = chosen - point.xyz
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        angles.append(np.degrees(np.arccos(np.clip(rays @ rays.T, -1, 1).min())))
    return np.array(angles) if angles else np.zeros(1)


def triangulate(clip: Clip, model: Any, matches: Path, folder: Path, progress: Progress) -> Cameras:
    """Triangulate matches for cameras that are known, which stay as they are."""
    progress(0, 1)
    quiet()
    with pycolmap.Database.open(matches) as opened:
        model = as_in_database(model, opened)
    target = folder / "model"
    target.mkdir(exist_ok=True)
    model = run(
        lambda token: pycolmap.triangulate_points(model, matches, clip.folder, target, cancellation_token=token),
        folder,
    )
    if model.num_points3D() < MIN_POINTS:
        raise InputError(
            f"{NOTHING_RECONSTRUCTED}: the given cameras see no common points; do the poses belong to these frames?"
        )
    write_model(model, target)
    progress(1, 1)
    return _as_given(clip, model, folder)


def as_in_database(model: Any, database: Any) -> Any:
    """The given cameras, which are one, under the database's numbers, and its camera replaced by the given one."""
    stored = database.read_all_cameras()[0]
    given = model.camera(model.image(model.reg_image_ids()[0]).camera_id)
    camera = pycolmap.Camera(model=given.model_name, width=given.width, height=given.height, params=given.params)
    camera.camera_id = stored.camera_id
    database.update_camera(camera)
    number_of = {image.name: image.image_id for image in database.read_all_images()}
    result = pycolmap.Reconstruction()
    result.add_camera_with_trivial_rig(camera)
    for image_id in model.reg_image_ids():
        given_image = model.image(image_id)
        if given_image.name in number_of:
            image = pycolmap.Image(
                name=given_image.name, camera_id=camera.camera_id, image_id=number_of[given_image.name]
            )
            result.add_image_with_trivial_frame(image, given_image.cam_from_world())
    return result


def adopt(clip: Clip, model: Any, folder: Path) -> Cameras:
    """Write a model that was given with its points."""
    target = folder / "model"
    write_model(model, target)
    return _as_given(clip, model, folder)


def _as_given(clip: Clip, model: Any, folder: Path) -> Cameras:
    return Cameras(
        folder,
        registered=tuple(_ranks(model, [frame.file for frame in clip.frames])),
        other_models=(),
        attempts=0,
        focal_was_kept=False,
        median_angle_deg=float(np.median(triangulation_angles_deg(model))),
    )
