"""A model over a camera path as plain Gaussians in world metres: what every exporter writes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aa4d.errors import InputError
from aa4d.export import harmonics
from aa4d.filming.camera_path import CameraPath, path_of_frames
from aa4d.identity import Identity
from aa4d.methods.model_file import LoadedModel
from aa4d.raster.types import Gaussians

FAINTEST = 1 / 255  # opacity below which no rasteriser draws a Gaussian: left out
MOST_EYES = 48  # that colors are fitted over
Array = NDArray[np.float64]

# From world (x east, y north, z up) to x right, y down, z forward, which splat viewers take for upright.
VIEWER = Rotation.from_matrix([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
# To x right, y up, z backward, which glTF and SPZ ask for.
Y_UP = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])


@dataclass(frozen=True)
class WorldGaussians:
    """N Gaussians at one instant, as one eye sees them."""

    ids: NDArray[np.int64]  # [N] anchor * K + offset: the same Gaussian at every time
    means: Array  # [N, 3] metres
    quaternions: Array  # [N, 4] w x y z, unit, w >= 0
    scales: Array  # [N, 3] standard deviations, metres
    opacities: Array  # [N] in [FAINTEST, 1]
    colors: Array  # [N, 3] sRGB in [0, 1]; with harmonics the constant part, 0.5 + SH_CONSTANT * c, of any size
    group: NDArray[np.int32] | None = None  # [N] the rigid group that it rides on, -1: the world; None: no groups
    harmonics: Array | None = None  # [N, (degree + 1)^2 - 1, 3] from degree 1 on; None: the same from all sides

    def coefficients(self) -> Array:
        """[N, (degree + 1)^2, 3] of spherical harmonics, the constant one first."""
        constant = (self.colors[:, None] - 0.5) / harmonics.SH_CONSTANT
        return constant if self.harmonics is None else np.concatenate([constant, self.harmonics], axis=1)


@dataclass(frozen=True)
class Clip:
    """Views in order. Anchors decode colours, opacities and shapes for an eye; formats without that get one's."""

    loaded: LoadedModel
    path: CameraPath
    eye: Array | None  # [3] metres, the same for all views; None: each view's own camera
    axes: str = "world"  # of aa4d.export.AXES
    identity: Identity | None = None  # of the export, for formats that can hold it
    origin: Mapping[str, float] | None = None  # where on Earth the world's is, likewise: `aa4d.export.origin`
    degree: int = 0  # of the spherical harmonics that hold how colors change with the side they are seen from

    def __len__(self) -> int:
        return len(self.path.views)

    def name(self, index: int) -> str:
        return self.path.views[index].name

    def seconds(self, index: int) -> float:
        """When a view is shown, on the clip's own clock; behind the last one, which lasts a mean step, its end."""
        if index < len(self):
            return float(self.path.at[index])
        return float(self.path.at[-1]) + 1 / self.path.fps

    def gaussians(self, index: int) -> WorldGaussians:
        gaussians = drawn(self.every_gaussian(index))
        return gaussians if self.axes == "world" else turned(gaussians, VIEWER)

    def some_gaussians(self, index: int) -> WorldGaussians:
        """`gaussians`, for formats whose files are never empty.

        Raises:
            InputError: there are none.
        """
        gaussians = self.gaussians(index)
        if not len(gaussians.ids):
            raise InputError(f"{self.loaded.path}: nothing is drawn in the view {self.name(index)}; take --format ply")
        return gaussians

    def every_gaussian(self, index: int) -> WorldGaussians:
        """All Gaussians of the model in a view, too faint to draw or not, in the world's axes; a row is its id."""
        t = self.path.views[index].t
        gaussians = every_gaussian(self.loaded, t, self.eye_at(index))
        if self.degree == 0:
            return gaussians
        rows = np.flatnonzero(gaussians.opacities >= FAINTEST)
        means = gaussians.means[rows]
        coefficients = sights(self.loaded, t, "training", rows).fit(means, self.degree)
        colors, rest = gaussians.colors.copy(), np.zeros((len(gaussians.ids), harmonics.count(self.degree) - 1, 3))
        colors[rows] = 0.5 + harmonics.SH_CONSTANT * coefficients[:, 0]
        rest[rows] = coefficients[:, 1:]
        return replace(gaussians, colors=colors, harmonics=rest)

    def color_errors(self, index: int) -> dict[str, float]:
        """How far the colors of one eye ("frozen") and the harmonics ("fitted") are off in a view.

        The root of the mean square over the held-out cameras, which the fit did not see, weighted by opacity.
        """
        frozen = drawn(every_gaussian(self.loaded, self.path.views[index].t, self.eye_at(index)))
        fitted = drawn(self.every_gaussian(index))
        seen = sights(self.loaded, self.path.views[index].t, "held-out", frozen.ids)
        parts = (("frozen", frozen), ("fitted", fitted))
        return {name: seen.error(frozen.means, gaussians.coefficients()) for name, gaussians in parts}

    def velocities(self, index: int, ids: NDArray[np.int64]) -> Array:
        """[N, 3] of the Gaussians `ids` in a view, metres a second of the clip's own clock, along its axes.

        Measured over half a view to each side, of which the first and the last view have one: a path that slows time
        down slows what moves in it, and one that freezes it freezes them.
        """
        t, last = [view.t for view in self.path.views], len(self) - 1
        before, after = max(index - 0.5, 0.0), min(index + 0.5, float(last))
        if self.loaded.is_static or after == before:
            return np.zeros((len(ids), 3))
        views, places = np.arange(last + 1), (before, after)
        instants, eye = np.interp(places, views, t), self.eye_at(index)
        first, second = (decoded_means(self.loaded, float(instant), eye)[ids] for instant in instants)
        velocity = (second - first) / np.diff(np.interp(places, views, self.path.at))
        return velocity if self.axes == "world" else np.asarray(VIEWER.apply(velocity))

    def labels(self) -> list[str]:
        """Lines for the header of a file: where on Earth it is, and the export's identity."""
        places = [] if self.origin is None else [f"geographic origin {json.dumps(dict(self.origin))}"]
        return places + ([] if self.identity is None else [f"aa4d {self.identity.as_text()}"])

    def group_names(self) -> tuple[str, ...]:
        groups = self.loaded.model.groups
        return () if groups is None else groups.names

    def eye_at(self, index: int) -> Array:
        """[3] metres, where a view is seen from."""
        return self.path.views[index].center() if self.eye is None else self.eye


def mean_eye(path: CameraPath) -> Array:
    """The mean of the places that the views are seen from, [3] metres."""
    return np.mean([view.center() for view in path.views], axis=0)


def turned(gaussians: WorldGaussians, rotation: Rotation) -> WorldGaussians:
    """All of them rotated about the origin."""
    own = Rotation.from_quat(gaussians.quaternions[:, [1, 2, 3, 0]])
    quaternions = (rotation * own).as_quat(canonical=True)[:, [3, 0, 1, 2]]
    moved = replace(gaussians, means=rotation.apply(gaussians.means), quaternions=quaternions)
    if gaussians.harmonics is None:
        return moved
    return replace(moved, harmonics=harmonics.turned(gaussians.coefficients(), rotation)[:, 1:])


def world_gaussians(loaded: LoadedModel, t: float, eye_m: Array) -> WorldGaussians:
    """All Gaussians at time t that are not too faint to draw, out of view or not, as seen from `eye_m` [3] metres.

    Those of a group that is not there at t have no opacity, so they are not among them. The model's frame is a uniform
    scale and a translation of the world: scales follow it, rotations do not change.
    """
    return drawn(every_gaussian(loaded, t, eye_m))


def drawn(gaussians: WorldGaussians) -> WorldGaussians:
    """Those that are not too faint to draw."""
    rows = np.flatnonzero(gaussians.opacities >= FAINTEST)
    columns = (getattr(gaussians, field.name) for field in fields(gaussians))
    kept: list[Any] = [None if column is None else column[rows] for column in columns]
    return WorldGaussians(*kept)


def every_gaussian(loaded: LoadedModel, t: float, eye_m: Array) -> WorldGaussians:
    """All Gaussians of the model, those too faint to draw as well; a row is its id."""
    frame, member = loaded.frame, loaded.model.group
    decoded = _decoded(loaded, t, eye_m)
    quaternions = decoded.quaternions.double().numpy()
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    quaternions = np.where(length > 1e-12, quaternions / np.maximum(length, 1e-12), [1.0, 0.0, 0.0, 0.0])
    return WorldGaussians(
        ids=np.arange(len(quaternions)),
        means=decoded.means.double().numpy() * frame.unit_m + frame.origin_m,
        quaternions=np.where(quaternions[:, :1] < 0, -quaternions, quaternions),
        scales=decoded.scales.double().numpy() * frame.unit_m,
        opacities=decoded.opacities.double().numpy(),
        colors=decoded.colors.clamp(0, 1).double().numpy(),  # harmonics may exceed 1
        group=None if member is None else member.numpy().repeat(loaded.model.per_unit).astype(np.int32),
    )


def sights(loaded: LoadedModel, t: float, views: str, rows: NDArray[np.int64]) -> harmonics.Sights:
    """What the capture's cameras of `views`, at most `MOST_EYES` of them, see of some Gaussians at time t."""
    cameras = path_of_frames(loaded, views).views
    eyes = np.stack([view.center() for view in cameras[:: -(-len(cameras) // MOST_EYES)]])
    seen = [_decoded(loaded, t, eye) for eye in eyes]
    return harmonics.Sights(
        eyes,
        np.stack([g.colors.clamp(0, 1).double().numpy()[rows] for g in seen], axis=1),
        np.stack([g.opacities.double().numpy()[rows] for g in seen], axis=1),
    )


def decoded_means(loaded: LoadedModel, t: float, eye_m: Array) -> Array:
    """[N, 3] metres: the centre of every Gaussian at time t, drawn or not; a row is its id."""
    return _decoded(loaded, t, eye_m).means.double().numpy() * loaded.frame.unit_m + loaded.frame.origin_m


def _decoded(loaded: LoadedModel, t: float, eye_m: Array) -> Gaussians:
    viewmat = np.eye(4)
    viewmat[:3, 3] = -eye_m
    with torch.no_grad():
        # Of a camera the decoder takes the place alone.
        camera = loaded.frame.camera(viewmat, np.eye(3), 1, 1)
        return loaded.model.gaussians(None if loaded.is_static else t, camera)
