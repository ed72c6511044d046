"""`aa4d capture`: from a video or a folder of frames to a capture folder. Every step runs once (workspace.py)."""

from __future__ import annotations

import dataclasses
import math
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

from aa4d import __version__
from aa4d.capture import features, mapping, matching, movers
from aa4d.capture.advice import Advice, advice, field_of_view_advice
from aa4d.capture.annotations import Annotations
from aa4d.capture.clip import Clip
from aa4d.capture.orientation import World, centres_of, find_world, kept_world
from aa4d.capture.pictures import save_png
from aa4d.capture.reader import BOXES, FARTHEST_M, Boxes, PinholeCamera
from aa4d.capture.report import write_report
from aa4d.capture.selection import make_clip, some
from aa4d.capture.selfcheck import check_capture
from aa4d.capture.settings import CaptureSettings
from aa4d.capture.sources import Source, open_source
from aa4d.capture.spacing import Pace, choose_spacing, spacing_advice
from aa4d.capture.undistortion import Undistortion, pinhole_boxes, pinhole_of, pinhole_pixels, viewmat_of
from aa4d.capture.workspace import DiskFullError, Progress, Workspace
from aa4d.capture.writing import Cloud, Shot, Sightings, digests_of_written, publish, write_capture
from aa4d.errors import InputError, Interrupted
from aa4d.files import LOCK, claimed, make_folder, read_json_object, write_json
from aa4d.identity import digest_of

Floats = NDArray[np.float64]
RECORD = "work/input.json"
FEWEST_VIEWS = 3  # a point that fewer frames have seen is often a mismatch


@dataclass(frozen=True)
class Made:
    """What was made, for the command and the report."""

    folder: Path
    frames: int  # in the capture
    used: int  # frames of the input that were tried
    points: int
    reprojection_px: float  # median, in frames of that size
    size: tuple[int, int]  # of the capture's frames: width and height
    fov_deg: float  # horizontal, of the capture's frames
    world: dict[str, Any]
    movers: str  # how they were found, and how much of the frames they cover
    notes: tuple[str, ...]
    advice: tuple[Advice, ...]
    seconds: dict[str, float]
    report: Path


def make_capture(
    path: Path, out: Path, settings: CaptureSettings, annotations: Path | None, watch: Callable[[str, bool], Progress]
) -> Made:
    """Make the capture `out` of `path`, or go on where an earlier call stopped.

    What was done is kept after Ctrl-C, a crash and on a full disk. After any other refusal, which the same command
    would only meet again, nothing is left of a new capture, and an earlier one stays as it was.

    Args:
        watch: called as each step begins, with its name and whether it was done before; returns its progress.

    Raises:
        InputError: bad input; one sentence that says what to do.
        Interrupted: Ctrl-C; what was done is kept.
    """
    for given in (path.resolve(), out.resolve()):
        if given != Path(os.fsencode(given).decode("utf-8", errors="replace")):
            raise InputError(f"{given}: has a name that is no text (UTF-8), which no report could show; rename it")
    if annotations is not None and settings.movers == "off":
        raise InputError(
            f"{annotations}: boxes are for masks, which --movers off switches off; leave out one of the two"
        )
    source = open_source(path, settings.selection, annotations)
    if source.posed is not None and settings.fov_deg is not None:
        raise InputError(f"{path}: gives its cameras and their field of view; leave out --fov")
    out = out.resolve() if ".." in out.parts else out  # `new/../used` is `used`
    was_there = out.exists()
    if not (out / LOCK).exists():  # a folder of something else is left untouched
        _check_folder(path, out)
    with claimed(out, "making a capture"):
        _check_folder(path, out)
        make_folder(out / "work")
        write_json(out / RECORD, {"input": str(path.resolve())})
        try:
            return _make(path, out, settings, source, Workspace(out / "work", watch))
        except KeyboardInterrupt:
            raise Interrupted(
                f"stopped; {out / 'work'} keeps what is done, and the same command continues there"
            ) from None
        except DiskFullError:
            raise
        except InputError:
            _withdraw(out, was_there)
            raise


def _withdraw(out: Path, was_there: bool) -> None:
    if (out / "capture.json").exists():
        unfinished = [*(out / "work").glob("*.part")]
    else:
        (out / LOCK).unlink()
        unfinished = [out / "work", *([] if was_there else [out])]
    for folder in unfinished:
        shutil.rmtree(folder, ignore_errors=True)


def _check_folder(path: Path, out: Path) -> None:
    """Raises InputError where `out` holds something other than a capture of this input."""
    record = out / RECORD
    if record.is_file():
        other = read_json_object(record, "the record of a capture's input").get("input")
        if other != str(path.resolve()):
            raise InputError(f"{out}: holds a capture of {other}; choose a new folder with --out")
    elif out.is_dir() and any(p.is_file() and not p.name.startswith(".") for p in out.rglob("*")):
        raise InputError(f"{out}: not empty, and no unfinished work of `aa4d capture`; choose a new folder with --out")


def _make(path: Path, out: Path, settings: CaptureSettings, source: Source, workspace: Workspace) -> Made:
    how = settings.reconstruction
    stamps = [(str(f), f.stat().st_size, f.stat().st_mtime_ns) for f in source.files]
    boxes = None if source.annotations is None else source.annotations.file.read_text(encoding="utf-8")

    follows = source.annotations is not None and source.annotations.follows  # movers are known again without a finder
    selection, pace, spaced = settings.selection, None, list[str]()
    if settings.movers == "auto" and not follows:
        chosen = workspace.step(
            "spacing",
            [stamps, selection.start_s, selection.end_s, selection.folder_fps, selection.is_open],
            lambda _, progress: choose_spacing(source, selection, progress),
        ).result
        pace = Pace(**chosen["pace"]) if chosen["pace"] else None
        selection, spaced = dataclasses.replace(selection, end_s=chosen["end_s"]), chosen["notes"]

    def frames_step(folder: Path, progress: Progress) -> dict[str, Any]:
        for leftover in folder.glob("*.*g"):
            leftover.unlink()
        made = make_clip(source.pictures, source.times_s(), selection, source.notes, folder, progress)
        return made.as_json()

    frames = workspace.step("frames", [stamps, dataclasses.asdict(selection)], frames_step)
    clip = Clip.from_json(frames.folder, frames.result)
    notes = [*clip.notes, *spaced]
    posed = source.posed
    given = None if posed is None else posed.of_clip(clip)

    masks: Path | None = None
    movers_told = "off"
    if settings.movers == "auto":
        masked = workspace.step(
            "movers",
            [boxes],
            lambda folder, progress: vars(movers.write_masks(clip, source.annotations, folder, progress)),
        )
        masks = masked.folder
        notes += masked.result["notes"]
        share = float(np.mean(masked.result["share"]))
        movers_told = f"{movers_kind(source)}, {100 * share:.2g} % of the pixels masked"

    geometry: dict[str, Any] = {"geometry": {}, "gaps": []}
    is_stated = settings.fov_deg is not None
    focal_px = _focal_px(settings.fov_deg, source.focal_share, clip)
    if posed is None or not posed.has_points:
        found = workspace.step(
            "features",
            [how.features, how.longest_px, how.camera_model, focal_px],
            lambda folder, progress: features.extract(clip, masks, how, focal_px, settings.threads, folder, progress),
        )
        matched = workspace.step(
            "matches",
            [how.window, how.keyframes, settings.seed],
            lambda folder, progress: matching.match(
                clip, found.folder / "database.db", how, settings.threads, settings.seed, folder, progress
            ),
        )
        geometry = matched.result
        database = matched.folder / "database.db"
    if posed is None:
        mapped = workspace.step(
            "cameras",
            [how.global_refinements, how.grown_by, settings.seed],
            lambda folder, progress: mapping.reconstruct(
                clip, database, geometry["geometry"], how, is_stated, settings.threads, settings.seed, folder, progress
            ),
        )
    elif not posed.has_points:
        mapped = workspace.step(
            "cameras",
            ["triangulate"],
            lambda folder, progress: mapping.triangulate(clip, given, database, folder, progress),
        )
    else:
        mapped = workspace.step("cameras", ["given"], lambda folder, _: mapping.adopt(clip, given, folder))
    result = mapped.result
    model = pycolmap.Reconstruction(mapped.folder / "model")
    notes += _left_out(clip, result)

    in_order = _images_in_order(model, clip)
    points = _points_of(model)
    world = _world(in_order, clip, points.positions, source, settings)
    notes += world.notes
    sim = world.to_world
    model.transform(pycolmap.Sim3d(sim.scale, pycolmap.Rotation3d(sim.rotation), sim.translation))
    cloud = _points_of(model)
    cameras = [model.camera(image.camera_id) for image, _ in in_order]
    pinhole = pinhole_of(list({c.camera_id: c for c in cameras}.values()), settings.size_px)
    shots = [
        Shot(Path(clip.frames[rank].file).stem, clip.frames[rank].label, clip.frames[rank].time_s, viewmat_of(image))
        for image, rank in in_order
    ]

    _check_reach(path, shots, world)

    def pictures_step(folder: Path, progress: Progress) -> dict[str, Any]:
        maps: dict[int, Undistortion] = {}
        for done, ((_, rank), camera) in enumerate(zip(in_order, cameras, strict=True), 1):
            if camera.camera_id not in maps:
                maps[camera.camera_id] = Undistortion(camera, pinhole)
            undistortion, frame = maps[camera.camera_id], clip.frames[rank]
            target = folder / f"{Path(frame.file).stem}.png"
            if not target.exists():
                if masks is not None:
                    moving = movers.read_mask(movers.mask_path(masks, frame.file))
                    white = np.where(moving, 255, 0).astype(np.uint8)
                    save_png(target.with_suffix(".mask.png"), undistortion.mask(white))
                save_png(target, undistortion.picture(clip.folder / frame.file))
            progress(done, len(in_order))
        return {}

    if damaged := _damaged(out, workspace):
        workspace.forget("capture")
        if any(name.endswith(".png") for name in damaged):
            workspace.forget("pictures")  # of which frames/ and movers/ are second names
    pictures = workspace.step("pictures", [settings.size_px], pictures_step)
    generator = {
        "input": path.name,
        "kind": source.kind,
        "preset": settings.preset,
        "registered": f"{len(shots)} of {len(clip.frames)}",
        "world": world.as_json(),
        "movers": settings.movers if masks is None else movers_kind(source),
        "notes": notes,
    }
    stored = None if source.annotations is None else _boxes(source.annotations, in_order, clip, model, pinhole)
    sightings = _sightings(in_order, model, pinhole, shots)
    observations = {
        name: (np.array([model.point3D(point).xyz for point in seen.ids]), seen.pixels)
        for name, seen in sightings.items()
    }

    shrunk = pinhole.K[0, 0] / float(np.median([c.focal_length_x for c in cameras]))

    made_from = _made_from(source, settings)

    def assemble_step(folder: Path, progress: Progress) -> dict[str, Any]:
        progress(0, 2)
        name = path.stem if path.is_file() else path.resolve().name
        write_capture(folder, name, pictures.folder, pinhole, shots, cloud, generator, stored, made_from, sightings)
        progress(1, 2)
        checked = check_capture(folder, observations, shrunk)
        checked["files"] = publish(folder, out)
        progress(2, 2)
        return checked

    has_boxes = [] if stored is None else [BOXES]
    checked = workspace.step("capture", [generator, settings.altitude_m, *has_boxes], assemble_step).result
    fov_deg = 2 * float(np.degrees(np.arctan(0.5 * pinhole.width / pinhole.K[0, 0])))
    said = [] if posed or focal_px else field_of_view_advice(geometry["geometry"], fov_deg, result["focal_was_kept"])
    if pace is not None:
        said += spacing_advice(pace, [shot.time_s for shot in shots], selection.most_frames)
    said += advice(
        len(shots) / len(clip.frames),
        checked["reprojection_px"]["median"] / shrunk,
        len(result["other_models"]),
        len(geometry["gaps"]),
        sum("blurred" in note for note in notes),
    )
    made = Made(
        folder=out,
        frames=len(shots),
        used=len(clip.frames),
        points=len(cloud.positions),
        reprojection_px=checked["reprojection_px"]["median"],
        size=(pinhole.width, pinhole.height),
        fov_deg=fov_deg,
        world=world.as_json(),
        movers=movers_told,
        notes=tuple(notes),
        advice=tuple(said),
        seconds=dict(workspace.seconds),
        report=out / "report.html",
    )
    write_report(made, clip, result, geometry, checked, shots, cloud, pinhole)
    write_json(out / "cost.json", {"seconds": sum(made.seconds.values()), "stages": made.seconds, "frames": []})
    return made


def _made_from(source: Source, settings: CaptureSettings) -> dict[str, str]:
    """The footage by names and sizes of its files, which tell a part of a clip from the whole of it; their pictures are
    in the capture itself. The number of threads belongs to the machine."""
    files = sorted((file.name, file.stat().st_size) for file in source.files)
    chosen = {"version": __version__, **dataclasses.asdict(dataclasses.replace(settings, threads=1))}
    return {"footage": digest_of(files), "settings": digest_of(chosen)}


def _damaged(out: Path, workspace: Workspace) -> list[str]:
    """Files of the finished capture that are no longer as they were written."""
    written: dict[str, str] = (workspace.result("capture") or {}).get("files", {})
    found = digests_of_written(out) if written else {}
    return [name for name, digest in written.items() if found.get(name) != digest]


def _focal_px(fov_deg: float | None, share: float | None, clip: Clip) -> float | None:
    """Of the clip's frames, as the user or else EXIF says; None where neither does."""
    if fov_deg is not None:
        return 0.5 * clip.width / math.tan(math.radians(fov_deg) / 2)
    return None if share is None else share * max(clip.width, clip.height)


def movers_kind(source: Source) -> str:
    return "epipolar motion" if source.annotations is None else f"boxes ({source.annotations.layout})"


def _left_out(clip: Clip, result: dict[str, Any]) -> list[str]:
    """What the model leaves out, in words: frames without a pose, and the other models."""
    said = []
    if result["attempts"] > 1:
        said.append(f"the cameras were found with lowered thresholds, at attempt {result['attempts']}: see the report")
    for ranks in result["other_models"]:
        first, last = clip.frames[ranks[0]], clip.frames[ranks[-1]]
        said.append(
            f"a second part of the clip, {len(ranks)} frames from {first.label} to {last.label}, could not be joined "
            "with the largest and was left out"
        )
    elsewhere = {rank for ranks in result["other_models"] for rank in ranks}
    lost = sorted(set(range(len(clip.frames))) - set(result["registered"]) - elsewhere)
    if lost:
        said.append(f"{some([clip.frames[i].label for i in lost])} left out: no pose could be found")
    return said


def _images_in_order(model: Any, clip: Clip) -> list[tuple[Any, int]]:
    """COLMAP images with a pose and their ranks in the clip, in presentation order."""
    rank_of = {frame.file: rank for rank, frame in enumerate(clip.frames)}
    found = [model.image(i) for i in model.reg_image_ids()]
    return sorted(((image, rank_of[image.name]) for image in found if image.name in rank_of), key=lambda pair: pair[1])


def _points_of(model: Any) -> Cloud:
    """Points that at least three frames have seen, or all where those are too few."""
    every = list(model.points3D.items())
    steady = [(number, p) for number, p in every if p.track.length() >= FEWEST_VIEWS]
    chosen = steady if len(steady) >= 100 else every
    return Cloud(
        np.array([p.xyz for _, p in chosen]).reshape(-1, 3),
        np.array([p.color for _, p in chosen], np.uint8).reshape(-1, 3),
        np.array([p.error for _, p in chosen], np.float64),
        np.array([number for number, _ in chosen], np.int64),
    )


def _world(
    in_order: list[tuple[Any, int]], clip: Clip, points: Floats, source: Source, settings: CaptureSettings
) -> World:
    viewmats = np.array([viewmat_of(image) for image, _ in in_order])
    if source.posed is not None and source.posed.world is not None:
        return kept_world(viewmats, points, source.posed.world, source.posed.is_metric, settings.altitude_m)
    positions = [clip.frames[rank].position for _, rank in in_order]
    return find_world(viewmats, points, positions, settings.altitude_m, settings.seed)


def _check_reach(path: Path, shots: list[Shot], world: World) -> None:
    """Raises InputError where a camera lies further from the origin than a capture may have it."""
    reach = np.abs(centres_of(np.array([shot.viewmat for shot in shots]))).max(axis=1)
    if reach.max() > FARTHEST_M:
        raise InputError(
            f"{path}: the camera of {shots[int(reach.argmax())].label} would lie {reach.max():.3g} from the origin "
            f"({world.scale_from}), over {FARTHEST_M:g}; leave that frame out, move the origin to the scene, "
            "or use a shorter part of the flight (--start, --end)"
        )


def _boxes(
    annotations: Annotations, in_order: list[tuple[Any, int]], clip: Clip, model: Any, pinhole: PinholeCamera
) -> Boxes:
    """The boxes of the capture's frames, in its pixels; those of which its frames show nothing are left out."""
    found = []
    for rank, (image, rank_in_clip) in enumerate(in_order):
        number = clip.frames[rank_in_clip].number
        if number is None or number not in annotations.boxes:
            continue
        camera = model.camera(image.camera_id)
        box = pinhole_boxes(camera, pinhole, annotations.boxes[number], clip.source_size)
        shown = (box[:, 2:] > box[:, :2]).all(axis=1)
        target, category = annotations.targets[number], annotations.categories[number]
        found.append(Boxes(np.full(int(shown.sum()), rank), target[shown], box[shown], category[shown]))
    if not found:
        return Boxes(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 4)), np.zeros(0, np.str_))
    return Boxes(
        *(np.concatenate([getattr(b, name) for b in found]) for name in ("frame", "target", "box_px", "category"))
    )


def _sightings(in_order: list[tuple[Any, int]], model: Any, pinhole: Any, shots: list[Shot]) -> dict[str, Sightings]:
    """By frame: the points that it shows, and where its pinhole picture shows them."""
    found = {}
    for (image, _), shot in zip(in_order, shots, strict=True):
        seen = image.get_observation_points2D()
        if len(seen):
            pixels = np.array([p.xy for p in seen])
            ids = np.array([p.point3D_id for p in seen], np.int64)
            found[shot.name] = Sightings(ids, pinhole_pixels(model.camera(image.camera_id), pinhole, pixels))
    return found
