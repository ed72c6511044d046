"""`aa4d capture`: from a video or a folder of frames to a capture folder. Every step runs once (workspace.py)."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from aa4d import __version__
from aa4d.capture.advice import (
    GOOD_ERROR_PX,
    Advice,
    advice,
    exif_advice,
    field_of_view_advice,
    horizon_advice,
    standing_out_advice,
    stated_field_of_view_advice,
)
from aa4d.capture.assembly import Published, capture_step, forget_damaged
from aa4d.capture.clip import Clip
from aa4d.capture.features import features_step, stated_focal_px
from aa4d.capture.focal import Tried, rivals
from aa4d.capture.horizon import horizon_of
from aa4d.capture.mapping import Cameras, adopt_step, solve_step, triangulate_step
from aa4d.capture.matching import Matches, matches_step
from aa4d.capture.movers import Masks, masking_method, movers_step
from aa4d.capture.overlay import NOTED, Overlay, overlay_step
from aa4d.capture.pictures import read_gray
from aa4d.capture.placement import Placement, place
from aa4d.capture.report import write_report
from aa4d.capture.second_look import SecondMasks, second_look_step
from aa4d.capture.selection import frames_step
from aa4d.capture.selfcheck import standing_out
from aa4d.capture.settings import CaptureSettings, Selection
from aa4d.capture.sources import Source, open_source
from aa4d.capture.spacing import Spacing, spacing_advice, spacing_step
from aa4d.capture.summary import CaptureSummary
from aa4d.capture.undistortion import Pictures, pictures_step
from aa4d.capture.workspace import DiskFullError, Progress, Workspace
from aa4d.errors import InputError, Interrupted
from aa4d.files import LOCK, claimed, make_folder, read_json_object, write_json
from aa4d.identity import digest_of

RECORD = "work/input.json"
LEFT_OUT_BY = "`aa4d train --set leave_out=true` leaves it out by left_out/all.png; scores count it all the same"


def make_capture(
    path: Path, out: Path, settings: CaptureSettings, annotations: Path | None, watch: Callable[[str, bool], Progress]
) -> CaptureSummary:
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
            raise InputError(f"{given}: file name is not valid UTF-8; rename it")
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


def _make(path: Path, out: Path, settings: CaptureSettings, source: Source, workspace: Workspace) -> CaptureSummary:
    spacing = _spacing(source, settings, workspace)
    clip = workspace.run(frames_step(source, _selection(settings, spacing)))
    given = None if source.posed is None else source.posed.of_clip(clip)
    looks_again = settings.movers != "off" and source.annotations is None
    masks = workspace.run(movers_step(clip, source.annotations)) if settings.movers != "off" else None
    overlay = workspace.run(overlay_step(clip)) if settings.overlay == "leave-out" else None
    matches = _matches(source, clip, masks, overlay, settings, workspace)
    if matches is None:
        cameras = workspace.run(adopt_step(clip, given))
    elif given is not None:
        cameras = workspace.run(triangulate_step(clip, given, matches))
    else:
        cameras = workspace.run(solve_step(clip, matches, settings))
    placement = place(path, source, clip, cameras, settings)
    left_out = None if overlay is None or not overlay.share else placement.of_pinhole(overlay.covers())
    notes = [
        *(note for note in clip.notes if left_out is None or not note.startswith(NOTED)),
        *(
            []
            if left_out is None
            else [f"{NOTED}, {100 * left_out.mean():.2g} % of it: no feature is found there, and {LEFT_OUT_BY}"]
        ),
        *([] if spacing is None else spacing.notes),
        *([] if masks is None else masks.notes),
        *([] if looks_again or settings.movers != "twice" else ["--movers twice adds nothing: boxes say what moves"]),
        *cameras.notes(clip),
        *placement.world.notes,
    ]
    forget_damaged(out, workspace)
    pictures = workspace.run(
        pictures_step(clip, placement.ranks, placement.cameras, placement.pinhole, masks, settings.size_px)
    )
    adds = settings.movers == "twice"
    second = workspace.run(second_look_step(placement, pictures, adds)) if looks_again else None
    boxes = None if source.annotations is None else placement.boxes(source.annotations, clip)
    generator = {
        "input": path.name,
        "kind": source.kind,
        "preset": settings.preset,
        "registered": f"{len(placement.shots)} of {len(clip.frames)}",
        "world": placement.world.as_json(),
        "movers": settings.movers if masks is None else masking_method(source.annotations),
        "notes": notes,
    }
    made_from = _made_from(source, settings)
    published = workspace.run(
        capture_step(path, out, placement, pictures, second, left_out, boxes, generator, made_from, settings.altitude_m)
    )
    pinhole, error_px = placement.pinhole, published.check.reprojection_px.median
    fov_deg = 2 * float(np.degrees(np.arctan(0.5 * pinhole.width / pinhole.K[0, 0])))
    summary = CaptureSummary(
        folder=out,
        frames=len(placement.shots),
        used=len(clip.frames),
        points=len(placement.cloud.positions),
        reprojection_px=error_px,
        size=(pinhole.width, pinhole.height),
        fov_deg=fov_deg,
        world=placement.world,
        movers=_movers(source, masks, second),
        notes=tuple(notes),
        advice=(
            *_field_of_view_advice(source, matches, cameras, placement, settings, fov_deg),
            *_spacing_advice(spacing, placement, settings),
            *_quality_advice(clip, matches, cameras, placement, pictures, published, notes),
        ),
        seconds=dict(workspace.seconds),
        report=out / "report.html",
    )
    write_report(summary, clip, cameras, matches, published.check, placement)
    seconds = summary.seconds
    write_json(out / "cost.json", {"seconds": sum(seconds.values()), "stages": seconds, "frames": []})
    return summary


def _made_from(source: Source, settings: CaptureSettings) -> dict[str, str]:
    """The footage by names and sizes of its files, which tell a part of a clip from the whole of it; their pictures are
    in the capture itself. The number of threads belongs to the machine."""
    files = sorted((file.name, file.stat().st_size) for file in source.files)
    chosen = {"version": __version__, **asdict(replace(settings, threads=1))}
    return {"footage": digest_of(files), "settings": digest_of(chosen)}


def _spacing(source: Source, settings: CaptureSettings, workspace: Workspace) -> Spacing | None:
    """None where movers need not be followed by what the frames show."""
    is_annotated = source.annotations is not None and source.annotations.follows
    if settings.movers == "off" or is_annotated:
        return None
    return workspace.run(spacing_step(source, settings.selection))


def _selection(settings: CaptureSettings, spacing: Spacing | None) -> Selection:
    return settings.selection if spacing is None else replace(settings.selection, end_s=spacing.end_s)


def _matches(
    source: Source,
    clip: Clip,
    masks: Masks | None,
    overlay: Overlay | None,
    settings: CaptureSettings,
    workspace: Workspace,
) -> Matches | None:
    """None where cameras and points were given."""
    if source.posed is not None and source.posed.has_points:
        return None
    how, threads = settings.reconstruction, settings.threads
    focal_px = stated_focal_px(settings.fov_deg, source.focal_share, clip)
    features = workspace.run(features_step(clip, masks, how, focal_px, threads, overlay))
    return workspace.run(matches_step(clip, features, how, threads, settings.seed))


def _movers(source: Source, masks: Masks | None, second: SecondMasks | None) -> str:
    if masks is None:
        return "off"
    first = f"{masking_method(source.annotations)}, {100 * float(np.mean(masks.share)):.2g} % of the pixels masked"
    return first if second is None else f"{first}; {100 * second.share:.2g} % at the second look, with cameras known"


def _field_of_view_advice(
    source: Source,
    matches: Matches | None,
    cameras: Cameras,
    placement: Placement,
    settings: CaptureSettings,
    fov_deg: float,
) -> list[Advice]:
    if source.focal_share is not None and settings.fov_deg is None:
        camera = placement.cameras[0]
        return exif_advice(source.focal_share, camera.mean_focal_length(), camera.width, camera.height)
    if cameras.freed:
        return stated_field_of_view_advice(*(Tried(**values) for values in cameras.freed))
    if matches is None or source.posed is not None:
        return []
    start = cameras.start
    return field_of_view_advice(matches.geometry, fov_deg, cameras.focal_was_kept, rivals(start.tried, start.chosen))


def _spacing_advice(spacing: Spacing | None, placement: Placement, settings: CaptureSettings) -> list[Advice]:
    if spacing is None or spacing.pace is None:
        return []
    return spacing_advice(spacing.pace, [shot.time_s for shot in placement.shots], settings.selection.most_frames)


def _quality_advice(
    clip: Clip,
    matches: Matches | None,
    cameras: Cameras,
    placement: Placement,
    pictures: Pictures,
    published: Published,
    notes: list[str],
) -> list[Advice]:
    shots, check = placement.shots, published.check
    grays = (read_gray(pictures.folder / f"{shot.name}.png") for shot in shots)
    viewmats, good_px = np.array([shot.viewmat for shot in shots]), GOOD_ERROR_PX * placement.shrinkage
    label_of = {shot.name: shot.label for shot in shots}
    apart = standing_out(list(label_of), viewmats, check.frame_px, good_px)
    horizon = horizon_of(grays, placement.pinhole.K, viewmats)
    said = horizon_advice(horizon, list(label_of.values())) + standing_out_advice([label_of[name] for name in apart])
    return said + advice(
        len(placement.shots) / len(clip.frames),
        published.check.reprojection_px.median / placement.shrinkage,
        len(cameras.other_models),
        0 if matches is None else len(matches.gaps),
        sum("blurred" in note for note in notes),
        next((note for note in notes if note in clip.notes and note.startswith(NOTED)), None),
    )
