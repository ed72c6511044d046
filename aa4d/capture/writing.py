"""Writing a capture folder from a reconstruction (docs/formats.md); capture.json comes last."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement

from aa4d import __version__
from aa4d.capture.content import CHECKSUMS, content_of, digests_of, listed
from aa4d.capture.pictures import save_png
from aa4d.capture.reader import CAPTURE_VERSION
from aa4d.capture.schema import FARTHEST_M, PinholeCamera
from aa4d.capture.truth import BOXES, LEFT_OUT, Boxes
from aa4d.files import whole_file, write_bytes, write_json, write_text
from aa4d.identity import Identity, digest_of_file

INDEX = "capture.json"
HELD_OUT_EVERY = 8
OPENCV_TO_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
LEFT_OUT_OF_ALL = f"{LEFT_OUT}/all.png"
WRITTEN = (
    "frames",
    "movers",
    LEFT_OUT_OF_ALL,
    "points.ply",
    "transforms.json",
    "sparse",
    CHECKSUMS,
    INDEX,
)  # the index comes last
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Shot:
    """One frame of the capture."""

    name: str
    label: str  # name in the source
    time_s: float
    viewmat: Floats  # [4, 4]


@dataclass(frozen=True)
class Cloud:
    positions: Floats  # [P, 3]
    colors: NDArray[np.uint8]  # [P, 3]
    errors_px: Floats  # [P]
    ids: NDArray[np.int64]  # [P] numbers by which sightings name them


@dataclass(frozen=True)
class Sightings:
    """M points that a frame shows, and where."""

    ids: NDArray[np.int64]  # [M] of points; those that are not in the cloud are left out
    pixels: Floats  # [M, 2] of the capture's camera


def write_capture(
    out: Path,
    name: str,
    pictures: Path,
    camera: PinholeCamera,
    shots: list[Shot],
    cloud: Cloud,
    generator: dict[str, Any],
    boxes: Boxes | None = None,
    made_from: dict[str, str] | None = None,
    sightings: dict[str, Sightings] | None = None,
    masks: Path | None = None,
    left_out: NDArray[np.bool_] | None = None,
) -> None:
    """Fill `out` from the undistorted `pictures` (NAME.png) and, where there are any, `masks` (NAME.mask.png).

    `sightings`, by the frame's name, are written into the COLMAP model.
    """
    for kind, suffix, made in (("frames", ".png", pictures), ("movers", ".mask.png", masks or pictures)):
        folder = out / kind
        shutil.rmtree(folder, ignore_errors=True)
        for shot in shots:
            source = made / f"{shot.name}{suffix}"
            if source.is_file():
                folder.mkdir(exist_ok=True)
                _link(source, folder / f"{shot.name}.png")
    if left_out is not None:
        (out / LEFT_OUT_OF_ALL).parent.mkdir(exist_ok=True)
        save_png(out / LEFT_OUT_OF_ALL, np.where(left_out, 255, 0).astype(np.uint8))
    if boxes is not None:
        (out / BOXES).parent.mkdir(exist_ok=True)
        content = BytesIO()
        np.savez(content, frame=boxes.frame, target=boxes.target, box_px=boxes.box_px, category=boxes.category)
        write_bytes(out / BOXES, content.getvalue())
    near = (np.abs(cloud.positions) < FARTHEST_M).all(axis=1)
    _write_points(out / "points.ply", cloud.positions[near], cloud.colors[near])
    _write_colmap(out / "sparse" / "0", camera, shots, cloud, sightings or {})
    first, last = shots[0].time_s, shots[-1].time_s
    document: dict[str, Any] = {
        "format": "aa4d-capture",
        "version": CAPTURE_VERSION,
        "name": name,
        "generator": {"program": "aa4d capture", "version": __version__, **generator},
        "fps": (len(shots) - 1) / (last - first),
        "camera": camera.as_json(),
        "points": "points.ply",
        "tracks": None,
        "checksums": CHECKSUMS,
        "frames": [
            {
                "name": shot.name,
                "image": f"frames/{shot.name}.png",
                "truth": None,
                "time_s": shot.time_s - first,
                "t": rank / (len(shots) - 1),
                "split": "test" if rank % HELD_OUT_EVERY == 0 else "train",
                "viewmat": shot.viewmat.tolist(),
                "source": shot.label,
            }
            for rank, shot in enumerate(shots)
        ],
        "instances": [],
    }
    write_json(out / "transforms.json", transforms(camera, document["frames"]))
    files = digests_of(out)
    write_json(out / CHECKSUMS, files)
    identity = Identity("capture", content_of(document, files), made_from or {})
    write_json(out / INDEX, document | {"identity": identity.as_json()})


def publish(made: Path, out: Path) -> dict[str, str]:
    """Move a capture that is whole into `out`, over the one that is there; returns its files' digests."""
    digests = digests_of_written(made)
    _remove(out / INDEX)
    painted = LEFT_OUT_OF_ALL not in (listed(out) or {})
    for part in WRITTEN:
        if part == LEFT_OUT_OF_ALL and painted and not (made / part).exists():
            continue  # somebody's own
        _remove(out / part)
        if (made / part).exists():
            (out / part).parent.mkdir(exist_ok=True)
            (made / part).replace(out / part)

    return digests


def digests_of_written(folder: Path) -> dict[str, str]:
    """SHA-256 of all files of the capture in `folder`, the index too; of those that are there."""
    others = (folder / name for name in (CHECKSUMS, INDEX))
    return digests_of(folder) | {path.name: digest_of_file(path) for path in others if path.is_file()}


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _link(source: Path, target: Path) -> None:
    """The same file under a second name where the disk can; a copy where it cannot."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


def _write_points(path: Path, positions: Floats, colors: NDArray[np.uint8]) -> None:
    types = [(n, "f4") for n in "xyz"] + [(n, "u1") for n in ("red", "green", "blue")]
    vertex = np.empty(len(positions), dtype=types)
    for name, values in zip(("x", "y", "z", "red", "green", "blue"), (*positions.T, *colors.T), strict=True):
        vertex[name] = values
    with whole_file(path) as temporary:
        PlyData([PlyElement.describe(vertex, "vertex")], byte_order="<").write(str(temporary))


def transforms(camera: PinholeCamera, frames: list[dict[str, Any]]) -> dict[str, Any]:
    """The content of transforms.json, of the frames of capture.json (docs/formats.md)."""
    K = camera.K
    names = {split: [f["image"] for f in frames if f["split"] == split] for split in ("train", "test")}
    return {
        "camera_model": "OPENCV",
        "w": camera.width,
        "h": camera.height,
        **dict(zip(("fl_x", "fl_y", "cx", "cy"), (K[0, 0], K[1, 1], K[0, 2], K[1, 2]), strict=True)),
        **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0),
        "ply_file_path": "points.ply",
        "applied_transform": np.eye(4)[:3].tolist(),
        "train_filenames": names["train"],
        "val_filenames": names["test"],
        "test_filenames": names["test"],
        "frames": [
            {
                "file_path": frame["image"],
                "transform_matrix": (np.linalg.inv(frame["viewmat"]) @ OPENCV_TO_OPENGL).tolist(),
                "time": frame["t"],
            }
            for frame in frames
        ],
    }


def _write_colmap(
    folder: Path, camera: PinholeCamera, shots: list[Shot], cloud: Cloud, sightings: dict[str, Sightings]
) -> None:
    from scipy.spatial.transform import Rotation

    folder.mkdir(parents=True, exist_ok=True)
    K = camera.K
    write_text(
        folder / "cameras.txt",
        f"1 PINHOLE {camera.width} {camera.height} {K[0, 0]!r} {K[1, 1]!r} {K[0, 2]!r} {K[1, 2]!r}\n",
    )
    lines = []
    row_of = {int(point): row for row, point in enumerate(cloud.ids)}
    tracks: list[list[str]] = [[] for _ in cloud.ids]
    for number, shot in enumerate(shots, 1):
        x, y, z, w = Rotation.from_matrix(shot.viewmat[:3, :3]).as_quat()
        pose = " ".join(repr(float(v)) for v in (w, x, y, z, *shot.viewmat[:3, 3]))
        seen: list[str] = []
        if shot.name in sightings:
            shown = sightings[shot.name]
            for point, (column, row) in zip(shown.ids.tolist(), shown.pixels.tolist(), strict=True):
                if point in row_of:
                    tracks[row_of[point]].append(f"{number} {len(seen)}")
                    seen.append(f"{column:.3f} {row:.3f} {row_of[point] + 1}")
        lines.append(f"{number} {pose} 1 {shot.name}.png\n{' '.join(seen)}\n")
    write_text(folder / "images.txt", "".join(lines))
    rows = zip(cloud.positions, cloud.colors, cloud.errors_px, tracks, strict=True)
    points = (
        f"{' '.join([f'{i} {p[0]:.9g} {p[1]:.9g} {p[2]:.9g} {c[0]} {c[1]} {c[2]} {e:.4g}', *track])}\n"
        for i, (p, c, e, track) in enumerate(rows, 1)
    )
    write_text(folder / "points3D.txt", "".join(points))
