"""The reconstruction placed in its world, and the one pinhole camera of all its frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

from aa4d.capture.annotations import Annotations
from aa4d.capture.clip import Clip
from aa4d.capture.mapping import Cameras
from aa4d.capture.orientation import World, centers_of, find_world, kept_world
from aa4d.capture.schema import FARTHEST_M, PinholeCamera
from aa4d.capture.settings import CaptureSettings
from aa4d.capture.sources import Source
from aa4d.capture.truth import Boxes
from aa4d.capture.undistortion import Undistortion, pinhole_boxes, pinhole_of, pinhole_pixels, viewmat_of
from aa4d.capture.writing import Cloud, Shot, Sightings
from aa4d.errors import InputError

MIN_VIEWS = 3  # a point that fewer frames have seen is often a mismatch

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Placement:
    """The N frames that have a pose, in presentation order."""

    model: Any  # pycolmap.Reconstruction, in the world
    images: list[Any]  # [N] COLMAP's
    ranks: list[int]  # [N] in the clip
    shots: list[Shot]  # [N]
    world: World
    cloud: Cloud
    pinhole: PinholeCamera

    @property
    def cameras(self) -> list[Any]:
        """[N] COLMAP's cameras, with their lens distortion."""
        return [self.model.camera(image.camera_id) for image in self.images]

    @property
    def shrinkage(self) -> float:
        """Pixels of the pinhole camera for one pixel of the frames that were reconstructed from."""
        return float(self.pinhole.K[0, 0] / float(np.median([c.focal_length_x for c in self.cameras])))

    def sightings(self) -> dict[str, Sightings]:
        """By frame: the points that it shows, and where its pinhole picture shows them."""
        found = {}
        for image, camera, shot in zip(self.images, self.cameras, self.shots, strict=True):
            seen = image.get_observation_points2D()
            if len(seen):
                pixels = np.array([p.xy for p in seen])
                ids = np.array([p.point3D_id for p in seen], np.int64)
                found[shot.name] = Sightings(ids, pinhole_pixels(camera, self.pinhole, pixels))
        return found

    def observations(self) -> dict[str, tuple[Floats, Floats]]:
        """By frame: world points [M, 3], and where its pinhole picture shows them [M, 2]."""
        return {
            name: (np.array([self.model.point3D(point).xyz for point in seen.ids]), seen.pixels)
            for name, seen in self.sightings().items()
        }

    def of_pinhole(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Mask of all the clip's frames as the pinhole camera sees it, whichever lens took the frame."""
        cameras = {camera.camera_id: camera for camera in self.cameras}
        white = np.where(mask, 255, 0).astype(np.uint8)
        seen = [Undistortion(camera, self.pinhole).mask(white) > 0 for camera in cameras.values()]
        return np.logical_or.reduce(seen)

    def boxes(self, annotations: Annotations, clip: Clip) -> Boxes:
        """The frames' boxes, in pixels of the pinhole camera; those of which its frames show nothing are left out."""
        found = [Boxes(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 4)), np.zeros(0, np.str_))]
        for rank, (rank_in_clip, camera) in enumerate(zip(self.ranks, self.cameras, strict=True)):
            number = clip.frames[rank_in_clip].number
            if number is None or number not in annotations.boxes:
                continue
            box = pinhole_boxes(camera, self.pinhole, annotations.boxes[number], clip.source_size)
            shown = (box[:, 2:] > box[:, :2]).all(axis=1)
            target, category = annotations.targets[number], annotations.categories[number]
            found.append(Boxes(np.full(int(shown.sum()), rank), target[shown], box[shown], category[shown]))
        return Boxes(
            *(np.concatenate([getattr(b, name) for b in found]) for name in ("frame", "target", "box_px", "category"))
        )


def place(path: Path, source: Source, clip: Clip, cameras: Cameras, settings: CaptureSettings) -> Placement:
    """Turn, move and scale the reconstruction of `path` so that up is z and, where anything says so, units are metres.

    Raises:
        InputError: a camera lies further from the origin than a capture may have it.
    """
    model = cameras.read()
    in_order = _images_in_order(model, clip)
    images, ranks = [image for image, _ in in_order], [rank for _, rank in in_order]
    viewmats = np.array([viewmat_of(image) for image in images])
    points, altitude_m = points_of(model).positions, settings.altitude_m
    if source.posed is not None and source.posed.world is not None:
        world = kept_world(viewmats, points, source.posed.world, source.posed.is_metric, altitude_m)
    else:
        positions = [clip.frames[rank].position for rank in ranks]
        world = find_world(viewmats, points, positions, altitude_m, settings.seed)
    sim = world.to_world
    model.transform(pycolmap.Sim3d(sim.scale, pycolmap.Rotation3d(sim.rotation), sim.translation))
    frames = [clip.frames[rank] for rank in ranks]
    shots = [
        Shot(Path(frame.file).stem, frame.label, frame.time_s, viewmat_of(image))
        for frame, image in zip(frames, images, strict=True)
    ]
    _check_reach(path, shots, world)
    used = {image.camera_id: model.camera(image.camera_id) for image in images}
    pinhole = pinhole_of(list(used.values()), settings.size_px)
    return Placement(model, images, ranks, shots, world, points_of(model), pinhole)


def _images_in_order(model: Any, clip: Clip) -> list[tuple[Any, int]]:
    """COLMAP images with a pose and their ranks in the clip, in presentation order."""
    rank_of = {frame.file: rank for rank, frame in enumerate(clip.frames)}
    found = [model.image(i) for i in model.reg_image_ids()]
    return sorted(((image, rank_of[image.name]) for image in found if image.name in rank_of), key=lambda pair: pair[1])


def points_of(model: Any) -> Cloud:
    """Points that at least three frames have seen, or all where those are too few."""
    every = list(model.points3D.items())
    steady = [(number, p) for number, p in every if p.track.length() >= MIN_VIEWS]
    chosen = steady if len(steady) >= 100 else every
    return Cloud(
        np.array([p.xyz for _, p in chosen]).reshape(-1, 3),
        np.array([p.color for _, p in chosen], np.uint8).reshape(-1, 3),
        np.array([p.error for _, p in chosen], np.float64),
        np.array([number for number, _ in chosen], np.int64),
    )


def _check_reach(path: Path, shots: list[Shot], world: World) -> None:
    reach = np.abs(centers_of(np.array([shot.viewmat for shot in shots]))).max(axis=1)
    if reach.max() > FARTHEST_M:
        raise InputError(
            f"{path}: the camera of {shots[int(reach.argmax())].label} would lie {reach.max():.3g} from the origin "
            f"({world.scale_from}), over {FARTHEST_M:g}; leave that frame out, move the origin to the scene, "
            "or use a shorter part of the flight (--start, --end)"
        )
