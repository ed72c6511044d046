"""Does a capture agree with itself? Recomputes what can be recomputed, and prints residuals beside their bounds.

python synth/verify.py captures/crossroads          (needs no Blender)
aa4d synth verify captures/crossroads
"""

import argparse
import hashlib
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np

HOME = Path(__file__).resolve().parent
sys.path[:] = [str(HOME.parent), *(entry for entry in sys.path if Path(entry).resolve() != HOME)]

from synth.develop import read_png  # noqa: E402
from synth.errors import InputError  # noqa: E402
from synth.files import write_json  # noqa: E402
from synth.identity import capture_identity  # noqa: E402
from synth.truth.activity import INTERMITTENT, PERSISTENT, UNSEEN, within  # noqa: E402
from synth.truth.boxes import corners, projected, visible  # noqa: E402
from synth.truth.flow import flow  # noqa: E402
from synth.truth.occlusion import occlusion  # noqa: E402
from synth.truth.recording import Array, Recording  # noqa: E402
from synth.truth.reprojection import round_trip  # noqa: E402

PAIRS = 24  # of frames, spread over the clip, whose points are reprojected
TRACK_TOLERANCE_M = 0.05
REPROJECTION_PX = 0.02
Statistic = Literal["median", "p99", "worst"]
MEDIAN: Statistic = "median"
MARKS = {"median": "~", "p99": " ", "worst": "*"}


@dataclass(frozen=True)
class Row:
    """One check: how many values, their 50th and 99th percentile and worst, and what one of these may be at most."""

    check: str
    unit: str
    count: int
    median: float
    p99: float
    worst: float
    bound: float
    bounded_statistic: Statistic = "p99"

    @property
    def passes(self) -> bool:
        return bool(getattr(self, self.bounded_statistic) <= self.bound)  # NaN fails

    def as_json(self) -> dict[str, object]:
        value = asdict(self)
        bounded = value.pop("bounded_statistic")
        return {**value, "of": bounded, "passes": self.passes}


def measured(check: str, unit: str, values: Array, bound: float, bounded_statistic: Statistic = "p99") -> Row:
    """A row over residuals; a check without values passes, and says 0."""
    values = np.asarray(values, dtype=np.float64).ravel()
    if not len(values):
        return Row(check, unit, 0, 0.0, 0.0, 0.0, bound, bounded_statistic)
    middle, high = np.percentile(values, [50, 99])
    return Row(check, unit, len(values), float(middle), float(high), float(values.max()), bound, bounded_statistic)


def faults(check: str, wrong: "Sequence[object] | Array", bound: float = 0.0) -> Row:
    """A row that counts what is wrong: one entry each, true or more than zero where it is."""
    wrong = np.asarray(wrong, dtype=np.float64).ravel()
    total = float((wrong > 0).sum())
    return Row(check, "wrong", len(wrong), total, total, total, bound, "worst")


def check_files(recording: Recording) -> Row:
    """Every file has the hash of checksums.json, and none is missing or added."""
    root, wrong = recording.root, []
    listed = recording.checksums()
    for name, expected in listed.items():
        path = root / name
        wrong.append(not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != expected)
    return faults("file hashes", wrong)


def check_identity(recording: Recording) -> Row:
    """The identity in capture.json is that of the index and of checksums.json; captures of older versions have none."""
    index = recording.index
    written = index.get("identity")
    if written is None:
        return faults("identity", [])
    return faults("identity", [capture_identity(index, recording.checksums(), written["made_from"]) != written])


def check_frames(recording: Recording) -> Iterator[Row]:
    index = recording.index
    frames = index["frames"]
    poses = np.array([frame[key] for frame in frames for key in ("viewmat", "viewmat_true") if key in frame])
    rotation = poses[:, :3, :3]
    off = np.abs(rotation @ np.swapaxes(rotation, 1, 2) - np.eye(3)).max(axis=(1, 2))
    yield measured("poses are rigid", "", np.maximum(off, np.abs(np.linalg.det(rotation) - 1)), 1e-9, "worst")
    times = np.array([frame["time_s"] for frame in frames])
    yield measured("times", "s", np.abs(times - np.arange(len(times)) / index["fps"]), 1e-9, "worst")
    yield measured("tracks' times", "s", np.abs(recording.tracks["time_s"] - times), 1e-9, "worst")
    yield measured("cameras of transforms.json", "", recording.against_transforms(), 1e-6, "worst")
    yield measured("cameras of sparse/0", "", recording.against_colmap(), 1e-6, "worst")


def check_images(recording: Recording) -> Row:
    wrong = []
    for frame in recording.index["frames"]:
        try:
            image = read_png((recording.root / frame["image"]).read_bytes())
            wrong.append(image.shape != (recording.size[1], recording.size[0], 3))
        except (OSError, ValueError):
            wrong.append(True)
    return faults("images", wrong)


def check_arrays(recording: Recording) -> Iterator[Row]:
    """Types, ranges, and that every id is somebody's."""
    bad, strangers, normals, classes = [], [], [], []
    shape = recording.size[::-1]
    for k in range(recording.count):
        truth = recording.truth(k)
        depth, ids = truth["depth_z"], truth["instance_id"]
        bad.append(
            depth.dtype != np.float32 or ids.dtype != np.uint32 or depth.shape != shape or ids.shape != shape
            or not (depth > 0).all() or bool((np.isinf(depth) & (ids > 0)).any())
        )  # fmt: skip
        strangers.append(~np.isin(np.unique(ids[ids > 0]), recording.tracks["instance_id"]))
        if "normal" in truth:
            hit = np.isfinite(depth)
            normal = truth["normal"][hit].astype(np.float64)
            towards = recording.view(k).surface(depth)[hit] - recording.eye(k)
            normals.append(np.abs(np.linalg.norm(normal, axis=1) - 1) + ((normal * towards).sum(axis=1) > 1e-3))
        if "class_id" in truth:
            classes.append((truth["class_id"] >= len(recording.index["classes"])).any())
    yield faults("depth and ids: type, size, range", bad)
    yield faults("ids that nobody has", np.concatenate(strangers))
    if normals:
        yield measured("normals: unit, facing the camera", "", np.concatenate(normals), 1e-3)
    if classes:
        yield faults("class ids", classes)


def check_reprojection(recording: Recording, advance: Callable[[], None]) -> Iterator[Row]:
    """Depth, poses and the motion of instances against each other: a point of one frame, found in another."""
    count = recording.count
    near = [(k, k + 1) for k in range(count - 1)]
    far = [(k, k + count // 2) for k in range(count - count // 2)] if count > 3 else []
    for name, pairs in (("to the next frame", near), ("over half the clip", far)):
        chosen = pairs if len(pairs) <= PAIRS else [pairs[i] for i in np.linspace(0, len(pairs) - 1, PAIRS).astype(int)]
        still, moving, lost = [], [], []
        for a, b in chosen:
            residual, on_instance, share = round_trip(recording, a, b)
            still.append(residual[~on_instance])
            moving.append(residual[on_instance])
            lost.append(share)
            advance()
        yield measured(f"reprojection {name}", "px", _joined(still), REPROJECTION_PX)
        yield measured(f"reprojection {name}, instances", "px", _joined(moving), REPROJECTION_PX)
        yield measured(f"not found again {name}", "share", np.array(lost), 0.5, MEDIAN)


def check_flow(recording: Recording, advance: Callable[[], None]) -> Iterator[Row]:
    residuals, masks, labels = [], [], []
    for k in range(recording.count):
        truth = recording.truth(k)
        depth, ids = truth["depth_z"], truth["instance_id"]
        for direction, other in (("forward", k + 1), ("backward", k - 1)):
            exists = 0 <= other < recording.count
            if recording.has("flow"):
                stored = recording.arrays(k, "flow")
                moved, valid = stored[f"flow_{direction}"].astype(np.float64), stored[f"{direction}_valid"]
                again, known = np.zeros(moved.shape), np.zeros(valid.shape, bool)
                if exists:
                    again, known = flow(recording.view(k), recording.view(other), depth, ids)  # type: ignore[assignment]
                both = valid & known
                residuals.append(np.linalg.norm(moved[both] - again[both], axis=-1))
                masks.append((valid != known) | (valid != np.isfinite(moved).all(axis=-1)))
            if recording.has("occlusion"):
                label = recording.arrays(k, "occlusion")[direction]
                expected = np.full(label.shape, 3, np.uint8)
                if exists:
                    there = recording.truth(other)
                    views = recording.view(k), recording.view(other)
                    expected = occlusion(*views, depth, ids, there["depth_z"], there["instance_id"])
                labels.append(label != expected)
        advance()
    if recording.has("flow"):
        yield measured("flow against depth, poses, motion", "px", _joined(residuals), 0.02)
        yield faults("validity of the flow", _joined(masks))
    if recording.has("occlusion"):
        row = _joined(labels)
        yield faults("occlusion", row, bound=1e-4 * len(row))


def check_instances(recording: Recording) -> Iterator[Row]:
    """Pixels of an instance lie in its box, and nothing moves that is said to stand."""
    tracks, outside = recording.tracks, []
    for k in range(recording.count):
        truth = recording.truth(k)
        ids = truth["instance_id"]
        view, on = recording.view(k), ids > 0
        member = view.index_of(ids)[on]
        known = member >= 0
        points, member = view.surface(truth["depth_z"])[on][known], member[known]
        pose, size = view.object_to_world[member], recording.dimensions_m[member]
        local = np.einsum("pji,pj->pi", pose[:, :3, :3], points - pose[:, :3, 3])
        beyond = np.maximum(np.abs(local[:, :2]) - 0.5 * size[:, :2], 0).max(axis=1)
        height = np.maximum(np.maximum(-local[:, 2], local[:, 2] - size[:, 2]), 0)
        outside.append(np.maximum(beyond, height))
    yield measured("pixels outside their instance's box", "m", _joined(outside), TRACK_TOLERANCE_M)
    yield faults("moving, from the speeds", tracks["moving"] != (tracks["speed_mps"] > 0.05))
    here = tracks["present"][1:] & tracks["present"][:-1]
    stands = here & ~(tracks["moving"][1:] | tracks["moving"][:-1])
    step = np.linalg.norm(np.diff(tracks["object_to_world"][:, :, :3, 3], axis=0), axis=-1)
    speed = np.maximum(tracks["speed_mps"][1:], tracks["speed_mps"][:-1])
    dt = np.diff(tracks["time_s"])[:, None]
    yield measured("steps of what stands", "m", np.maximum(step - 0.05 * dt - speed * dt, 0)[stands], 0.05)


def check_boxes(recording: Recording) -> Iterator[Row]:
    counts_off, corners_off, pixels_off = [], [], []
    counted = recording.pass_arrays("visible_pixels")
    boxes = recording.pass_arrays("boxes")
    for k in range(recording.count):
        view = recording.view(k)
        counts, seen = visible(recording.truth(k)["instance_id"], view.instance_id)
        if counted is not None:
            counts_off.append(counted["visible_pixels"][k] != counts)
        if boxes is not None:
            world = corners(view.object_to_world, recording.dimensions_m)
            pixels, box = projected(view, world)
            corners_off.append(np.abs(boxes["corners_m"][k] - world))
            for stored, again in ((boxes["corners_px"][k], pixels), (boxes["box_px"][k], box)):
                disagree = np.isnan(stored) != np.isnan(again)
                pixels_off.append(np.where(disagree, np.inf, np.nan_to_num(np.abs(stored - again))).ravel())
            pixels_off.append(np.abs(boxes["visible_box_px"][k] - seen).ravel())
    if counted is not None:
        yield faults("visible pixels", _joined(counts_off))
    if boxes is not None:
        yield measured("corners of boxes", "m", _joined(corners_off), 1e-6, "worst")
        yield measured("boxes in the picture", "px", _joined(pixels_off), 1e-3, "worst")


def check_activity(recording: Recording) -> Iterator[Row]:
    """Labels of pixels are those of their instances, the sky is unseen, and who never moves is not active."""
    stored = recording.pass_arrays("activity")
    if stored is None:
        return
    label = stored["instance_label"]
    wrong_pixels, wrong_cells = [], []
    for k in range(recording.count):
        truth, view = recording.truth(k), recording.view(k)
        pixels = read_png((recording.root / recording.index["frames"][k]["activity"]).read_bytes())
        member = view.index_of(truth["instance_id"])
        active = (label == INTERMITTENT) | (label == PERSISTENT)
        on = member >= 0
        wrong_pixels += [
            (pixels == UNSEEN) != np.isinf(truth["depth_z"]),
            on & active[np.maximum(member, 0)] & (pixels != label[np.maximum(member, 0)]) if len(label) else on,
            ~on & np.isin(pixels, (INTERMITTENT, PERSISTENT)),
        ]
        seen = stored["cell_label_at"][k] != UNSEEN
        wrong_cells.append(seen & (stored["cell_label_at"][k] != stored["cell_label"]))
    yield faults("activity of pixels", _joined(wrong_pixels))
    yield faults("activity of cells", _joined(wrong_cells))
    moves = (recording.tracks["moving"] & recording.tracks["present"]).any(axis=0)
    yield faults("activity of instances", moves & (label != INTERMITTENT) & (label != PERSISTENT))
    runs, times, moved = stored["moving_interval"], recording.tracks["time_s"], []
    for m in range(len(label)):
        moving = recording.tracks["moving"][:, m] & recording.tracks["present"][:, m]
        moved.append(within(runs[runs[:, 0] == m, 1:], times) != moving)
    yield faults("intervals of motion", _joined(moved))


def check_rows(recording: Recording) -> Iterator[Row]:
    """The pose of a frame lies between those of its middle rows."""
    if "rows" not in recording.index:
        return
    rows = recording.file(recording.index["rows"])
    height = recording.size[1]
    middle = [(height - 1) // 2, height // 2]
    two = rows["row_viewmat"][:, middle]
    off = np.abs(two.mean(axis=1) - recording.viewmats) - np.abs(two[:, 1] - two[:, 0])
    yield measured("poses of the middle rows", "", np.maximum(off, 0), 1e-6, "worst")
    times = [frame["time_s"] for frame in recording.index["frames"]]
    yield measured("times of the rows", "s", np.abs(rows["row_time_s"].mean(axis=1) - times), 1e-9, "worst")


def check_points(recording: Recording) -> Row:
    """Every point of points.ply lies on a surface that a frame shows."""
    return measured("points.ply off every surface", "share of the depth", recording.points_off_surface(), 0.02)


def _joined(parts: Sequence[Array]) -> Array:
    return np.concatenate([np.asarray(part).ravel() for part in parts]) if len(parts) else np.empty(0)


def verify(root: Path, advance: Callable[[], None] = lambda: None) -> list[Row]:
    """All checks that the capture's files allow.

    Raises:
        InputError: it is not a capture with truth, or a file cannot be read.
    """
    recording = Recording(root)
    rows = [
        check_files(recording),
        check_identity(recording),
        check_images(recording),
        *check_frames(recording),
        *check_arrays(recording),
    ]
    rows += [*check_reprojection(recording, advance), *check_flow(recording, advance), *check_instances(recording)]
    rows += [*check_boxes(recording), *check_activity(recording), *check_rows(recording), check_points(recording)]
    return rows


def table(rows: Sequence[Row]) -> str:
    """The rows for a terminal."""
    lines = [f"{'check':40} {'values':>9} {'median':>10} {'99 %':>10} {'worst':>10} {'bound':>10}  "]
    for row in rows:
        limit = f"{row.bound:10.3g}{MARKS[row.bounded_statistic]}"
        numbers = f"{row.count:9d} {row.median:10.3g} {row.p99:10.3g} {row.worst:10.3g} {limit}"
        lines.append(f"{row.check:40} {numbers} {row.unit + ' ' if row.unit else ''}{'ok' if row.passes else 'FAILS'}")
    return "\n".join([*lines, "bound: of the 99th percentile; * of the worst; ~ of the median"])


def main(arguments: Sequence[str]) -> int:
    """0 everything agrees, 1 something does not, 2 it cannot be checked."""
    parser = argparse.ArgumentParser(prog="verify", description=__doc__.split("\n", 1)[0])
    parser.add_argument("capture", type=Path, metavar="CAPTURE", help="a finished capture folder")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the table to a file, for machines")
    try:
        options = parser.parse_args(arguments)
        rows = verify(options.capture)
        print(table(rows))
        if options.json is not None:
            write_json(options.json, [row.as_json() for row in rows])
    except SystemExit as stop:
        return int(stop.code or 0)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    failed = [row.check for row in rows if not row.passes]
    if failed:
        print(f"{options.capture}: does not agree with itself: {', '.join(failed)}.", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
