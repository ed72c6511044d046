"""A finished capture as arrays, by the words of docs/formats.md alone."""

import json
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.camera import OPENCV_TO_OPENGL, invert_rigid, quaternion
from synth.errors import InputError
from synth.lens import Lens, Pinhole
from synth.truth.view import View

Array = NDArray[Any]
KEPT = 6  # frames whose arrays stay in memory


class Recording:
    """The index, and arrays read when they are asked for.

    Raises:
        InputError: here and in every method, where a file is missing, damaged or outside the folder.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        if not (root / "capture.json").is_file():
            raise InputError(f"{root}: has no capture.json: not a capture, or an unfinished one; run its synth again.")
        self.index: dict[str, Any] = self._json("capture.json")
        try:
            self._read_index()
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{root / 'capture.json'}: {error!r} is missing or malformed; docs/formats.md.") from None
        self.truth = lru_cache(maxsize=KEPT)(self._truth)

    def _read_index(self) -> None:
        frames, camera = self.index["frames"], self.index["camera"]
        self.count = len(frames)
        self.size = (int(camera["width"]), int(camera["height"]))
        self.lens = lens_of(camera)
        self.viewmats = np.array([frame.get("viewmat_true", frame["viewmat"]) for frame in frames], dtype=np.float64)
        if self.viewmats.shape != (self.count, 4, 4):
            raise ValueError("viewmat")
        if self.index.get("tracks") is None or any(frame.get("truth") is None for frame in frames):
            raise InputError(f"{self.root}: has no ground truth to check.")
        self.tracks = self.file(self.index["tracks"])
        sizes = {i["id"]: i["dimensions_m"] for i in self.index["instances"]}
        self.dimensions_m = np.array([sizes[int(i)] for i in self.tracks["instance_id"]]).reshape(-1, 3)
        if "present" not in self.tracks:
            self.tracks["present"] = np.ones_like(self.tracks["moving"])

    def path(self, name: str) -> Path:
        """A file of the capture by its relative path."""
        pure = PurePosixPath(name)
        if pure.is_absolute() or ".." in pure.parts or "\\" in name:
            raise InputError(f"{self.root / 'capture.json'}: {name!r} leaves the capture folder.")
        return self.root / name

    def file(self, name: str) -> dict[str, Array]:
        """The arrays of an .npz file."""
        try:
            with np.load(self.path(name), allow_pickle=False) as arrays:
                return dict(arrays)
        except Exception as error:  # zipfile, zlib and numpy each raise their own kind for a damaged file
            raise InputError(f"{self.root / name}: cannot be read ({error}); make the capture again.") from None

    def _json(self, name: str) -> Any:
        try:
            return json.loads(self.path(name).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(f"{self.root / name}: cannot be read ({error}); make the capture again.") from None

    def _truth(self, k: int) -> dict[str, Array]:
        """depth_z, instance_id and what else a frame's truth holds."""
        return self.file(self.index["frames"][k]["truth"])

    def has(self, name: str) -> bool:
        """Whether frames have a pass of their own file."""
        return name in self.index["frames"][0]

    def arrays(self, k: int, name: str) -> dict[str, Array]:
        """The arrays of such a file."""
        return self.file(self.index["frames"][k][name])

    def pass_arrays(self, name: str) -> dict[str, Array] | None:
        """A pass in one file for all frames; None where the capture lacks it."""
        return self.file(self.index[name]) if name in self.index else None

    def view(self, k: int) -> View:
        """A frame's camera and instances."""
        order = np.argsort(self.tracks["instance_id"])
        return View(
            self.lens,
            self.size,
            self.viewmats[k],
            self.tracks["instance_id"][order],
            self.tracks["object_to_world"][k][order],
            self.tracks["present"][k][order],
        )

    def eye(self, k: int) -> Array:
        """Where the camera is [3]."""
        return invert_rigid(self.viewmats[k])[:3, 3]

    def checksums(self) -> dict[str, str]:
        """SHA-256 of every file by its path."""
        listed = self._json(self.index["checksums"]) if "checksums" in self.index else {}
        return {name: value for name, value in listed.items() if self.path(name)}

    def against_transforms(self) -> Array:
        """Differences of transforms.json from the index: focal length and centre in pixels, poses."""
        told = self._json("transforms.json")
        K = self.lens.K
        off = [told["fl_x"] - K[0, 0], told["fl_y"] - K[1, 1], told["cx"] - K[0, 2], told["cy"] - K[1, 2]]
        for frame, other in zip(self.index["frames"], told["frames"], strict=True):
            pose = invert_rigid(np.array(frame["viewmat"])) @ OPENCV_TO_OPENGL
            off.append(np.abs(pose - np.array(other["transform_matrix"])).max())
        return np.abs(off)

    def against_colmap(self) -> Array:
        """Differences of the COLMAP model from the index."""

        def lines(name: str) -> list[list[str]]:
            text = (self.root / "sparse" / "0" / name).read_text(encoding="utf-8")
            return [line.split() for line in text.split("\n") if not line.startswith("#")]

        K = self.lens.K
        told = np.array(lines("cameras.txt")[0][4:8], dtype=np.float64)
        off = list(told - [K[0, 0], K[1, 1], K[0, 2], K[1, 2]])
        for frame, words in zip(self.index["frames"], lines("images.txt")[::2], strict=False):
            values = np.array(words[1:8], dtype=np.float64)
            pose = np.array(frame["viewmat"])
            turned = quaternion(pose[:3, :3])
            off.append(1 - abs(float(turned @ values[:4])))
            off.append(np.abs(pose[:3, 3] - values[4:]).max())
        return np.abs(off)

    def points_off_surface(self) -> Array:
        """For every point of points.ply how far it is from the depth of the frame that agrees best, relative [P]."""
        content = self.path(self.index["points"]).read_bytes()
        head, _, body = content.partition(b"end_header\n")
        if b"format binary_little_endian 1.0" not in head or len(body) % 15:
            raise InputError(f"{self.root / self.index['points']}: not the point cloud of docs/formats.md.")
        xyz = np.frombuffer(body, dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3)])["xyz"].astype(np.float64)
        best = np.full(len(xyz), np.inf)
        for k in range(self.count):
            uv, depth = self.view(k).project(xyz)
            size = np.array(self.size)
            with np.errstate(invalid="ignore"):
                inside = np.flatnonzero(((uv >= 0) & (uv < size)).all(axis=1))
            column, row = uv[inside].astype(np.int64).T
            off = np.abs(self.truth(k)["depth_z"][row, column] / depth[inside] - 1)
            best[inside] = np.minimum(best[inside], off)
        return best


def lens_of(camera: dict[str, Any]) -> Lens:
    """The lens that capture.json describes."""
    K = np.array(camera["K"], dtype=np.float64)
    if camera["model"] == "PINHOLE":
        return Pinhole(K)
    if camera["model"] == "OPENCV":
        from synth.effects.lens_distortion import Settings, lens

        return lens(Settings(**camera["distortion"]), K, (camera["width"], camera["height"]))
    raise ValueError(f"camera model {camera['model']!r}")
