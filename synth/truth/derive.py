"""The passes that are computed from what was rendered: written file by file, so that a stopped run goes on."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.capture import Folder
from synth.costs import Costs
from synth.develop import png
from synth.files import write_bytes, write_npz
from synth.plan import Frame, Plan
from synth.truth.activity import (
    APPEARANCE_ONLY,
    STATIC,
    UNSEEN,
    Grid,
    active_share,
    changes_per_second,
    footprints,
    grid_around,
    heterogeneity_in_space,
    heterogeneity_in_time,
    intervals,
    label_of,
    sample_times,
)
from synth.truth.boxes import corners, projected, visible
from synth.truth.flow import flow
from synth.truth.occlusion import occlusion
from synth.truth.view import View

FARTHEST_M = 250.0  # from the camera: beyond, the ground has no cells
BRIGHTNESS_CHANGE = 0.05  # relative: more is a change of appearance


def view_of(plan: Plan, frame: Frame) -> View:
    """A frame of a plan with exact poses."""
    camera = plan.scene.camera
    ids = np.arange(1, len(plan.cast.present(0.0)) + 1, dtype=np.uint32)
    return View(
        plan.lens,
        (camera.width_px, camera.height_px),
        frame.viewmat,
        ids,
        plan.cast.object_to_world(frame.time_s),
        plan.cast.present(frame.time_s),
    )


def derive(plan: Plan, folder: Folder, costs: Costs, advance: Callable[[float], None]) -> dict[str, Any]:
    """Write every asked pass that is missing; returns what capture.json says about them."""
    asked, said = plan.scene.truth.passes, {}
    for name in ("flow", "occlusion"):
        if name in asked:
            for frame in plan.frames:
                path = folder.truth_pass(name, frame)
                if not path.is_file():
                    with costs.stage(name):
                        folder.keep_arrays(path, **_pairs(plan, folder, frame, name))
                advance(1.0)
    if "visible_pixels" in asked or "boxes" in asked:
        with costs.stage("boxes"):
            arrays = _boxes(plan, folder)
            for name, keys in (("visible_pixels", ("visible_pixels",)), ("boxes", BOX_ARRAYS)):
                if name in asked:
                    head = {key: arrays[key] for key in ("instance_id", "time_s")}
                    write_npz(folder.root / "truth" / f"{name}.npz", **head, **{key: arrays[key] for key in keys})
                    said[name] = f"truth/{name}.npz"
        advance(len(plan.frames))
    if "activity" in asked:
        with costs.stage("activity"):
            said |= _activity(plan, folder)
        advance(len(plan.frames))
    return said


def steps(plan: Plan) -> int:
    """How often `derive` advances, in all."""
    asked = plan.scene.truth.passes
    return len(plan.frames) * (("flow" in asked) + ("occlusion" in asked) + ("activity" in asked)
                               + ("boxes" in asked or "visible_pixels" in asked))  # fmt: skip


def _pairs(plan: Plan, folder: Folder, frame: Frame, name: str) -> dict[str, NDArray[Any]]:
    """A pass towards the next and the previous frame."""
    here, truth = view_of(plan, frame), folder.read_truth(frame)
    depth, ids = truth["depth_z"], truth["instance_id"]
    result: dict[str, NDArray[Any]] = {}
    for direction, rank in (("forward", frame.rank + 1), ("backward", frame.rank - 1)):
        exists = 0 <= rank < len(plan.frames)
        if name == "flow":
            moved, valid = np.full((*depth.shape, 2), np.nan, np.float32), np.zeros(depth.shape, bool)
            if exists:
                moved, valid = flow(here, view_of(plan, plan.frames[rank]), depth, ids)
            result[f"flow_{direction}"], result[f"{direction}_valid"] = moved, valid
        elif exists:
            there = plan.frames[rank]
            other = folder.read_truth(there)
            result[direction] = occlusion(
                here, view_of(plan, there), depth, ids, other["depth_z"], other["instance_id"]
            )
        else:
            result[direction] = np.full(depth.shape, 3, np.uint8)
    return result


BOX_ARRAYS = ("corners_m", "corners_px", "box_px", "visible_box_px")


def _boxes(plan: Plan, folder: Folder) -> dict[str, NDArray[Any]]:
    size = np.array([member.dimensions_m for member in plan.cast.members()]).reshape(-1, 3)
    rows: dict[str, list[NDArray[Any]]] = {name: [] for name in (*BOX_ARRAYS, "visible_pixels")}
    for frame in plan.frames:
        view = view_of(plan, frame)
        world = corners(view.object_to_world, size)
        pixels, box = projected(view, world)
        counts, seen = visible(folder.read_truth(frame)["instance_id"], view.instance_id)
        found: tuple[NDArray[Any], ...] = (world, pixels, box, seen, counts)
        for name, value in zip(rows, found, strict=True):
            rows[name].append(value)
    arrays = {name: np.stack(values) for name, values in rows.items()}
    times = np.array([frame.time_s for frame in plan.frames])
    return {"instance_id": view.instance_id, "time_s": times, **arrays}


def _activity(plan: Plan, folder: Folder) -> dict[str, Any]:
    """Labels of instances, cells and pixels, and the two indices."""
    frame_times = np.array([frame.time_s for frame in plan.frames])
    times = sample_times(frame_times)
    moving = np.stack([plan.cast.moving(float(t)) for t in times])
    present = np.stack([plan.cast.present(float(t)) for t in times])
    lit = np.stack([plan.cast.lit(float(t)) for t in times])
    blinks = lit.any(axis=0) & ~lit.all(axis=0)
    instance_label = label_of(moving, blinks, present)
    size = np.array([member.dimensions_m for member in plan.cast.members()]).reshape(-1, 3)

    grid = _common_grid(plan, folder)
    active = np.stack([footprints(grid, *_movers(plan, size, float(t))) for t in times])
    changes = _brightness_changes(plan, grid, times) | footprints(
        grid, plan.cast.object_to_world(0.0), size, blinks & ~moving.any(axis=0)
    )
    cells = label_of(active.reshape(len(times), -1), changes.ravel()).reshape(grid.shape)
    seen = np.zeros((len(plan.frames), grid.shape[0] * grid.shape[1]), dtype=bool)
    for frame in plan.frames:
        where = grid.cell_of(_near_surface(plan, folder, frame))
        seen[frame.rank, where[where >= 0]] = True
        labels = _pixels(folder.read_truth(frame), instance_label, where, changes)
        write_bytes(folder.truth_pass("activity", frame), png(labels))
    seen = seen.reshape(-1, *grid.shape)
    ever = np.where(seen.any(axis=0), cells, UNSEEN).astype(np.uint8)
    between = max(1, (len(times) - 1) // max(1, len(plan.frames) - 1))
    end_s = len(plan.frames) / plan.scene.time.fps
    on_off = [(m, *run) for m in range(len(size)) for run in intervals(times, moving[:, m] & present[:, m], end_s)]
    write_npz(
        folder.root / "truth" / "activity.npz",
        instance_id=np.arange(1, len(size) + 1, dtype=np.uint32),
        instance_label=instance_label,
        moving_interval=np.array(on_off).reshape(-1, 3),
        time_s=frame_times,
        cell_label=ever,
        cell_label_at=np.where(seen, cells, UNSEEN).astype(np.uint8),
        cell_active=active[::between],
        origin_m=np.array(grid.origin_m),
        cell_m=np.array(grid.cell_m),
    )
    watched = active[:, seen.any(axis=0)]
    indices = {
        "space": heterogeneity_in_space(ever),
        "time": heterogeneity_in_time(watched),
        "active_share": active_share(watched),
        "changes_per_s": changes_per_second(watched, float(times[-1] - times[0])),
    }
    return {"activity": "truth/activity.npz", "heterogeneity": {k: round(v, 6) for k, v in indices.items()}}


def _movers(plan: Plan, size: NDArray[np.float64], time_s: float) -> tuple[NDArray[Any], ...]:
    """Poses, sizes and which members move, as `footprints` takes them."""
    return plan.cast.object_to_world(time_s), size, plan.cast.moving(time_s) & plan.cast.present(time_s)


def _near_surface(plan: Plan, folder: Folder, frame: Frame) -> NDArray[np.float64]:
    """World points [H, W, 3]; NaN for what is far."""
    depth = folder.read_truth(frame)["depth_z"]
    return view_of(plan, frame).surface(np.where(depth < FARTHEST_M, depth, np.float32(np.inf)))


def _common_grid(plan: Plan, folder: Folder) -> Grid:
    """The cells that cover what any frame sees."""
    reached = []
    for frame in plan.frames:
        points = _near_surface(plan, folder, frame).reshape(-1, 3)
        points = points[np.isfinite(points[:, 0])]
        if len(points):
            reached += [points.min(axis=0), points.max(axis=0)]
    return grid_around(np.array(reached).reshape(-1, 3), plan.scene.truth.cell_m)


def _brightness_changes(plan: Plan, grid: Grid, times: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Cells [R, C] whose light an effect changes over time."""
    changes = np.zeros(grid.shape, dtype=bool)
    centres = grid.centres()
    for staging in plan.staging:
        values = [v for t in times if (v := staging.brightness(centres, float(t))) is not None]
        if values:
            low, high = np.min(values, axis=0), np.max(values, axis=0)
            changes |= high - low > BRIGHTNESS_CHANGE * high
    return changes


def _pixels(
    truth: dict[str, NDArray[Any]],
    instance_label: NDArray[np.uint8],
    where: NDArray[np.int64],
    changes: NDArray[np.bool_],
) -> NDArray[np.uint8]:
    """Labels [H, W] of a frame: the instance's, else the light's on the cell below; `where` is each pixel's cell."""
    ids = truth["instance_id"]
    changing = (where >= 0) & changes.ravel()[np.maximum(where, 0)]
    still = np.concatenate([[STATIC], instance_label])[np.minimum(ids, len(instance_label))]
    labels = np.where((still == STATIC) & changing, APPEARANCE_ONLY, still)
    return np.where(np.isinf(truth["depth_z"]), UNSEEN, labels).astype(np.uint8)
