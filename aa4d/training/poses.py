"""Camera poses that are learned with the scene (`aa4d train --refine-poses`).

Every training camera has a twist xi = (omega, v), radians and model units, that moves it in its own axes:
V' = Exp(xi) V, with Exp the exponential map of SE(3) (Sola, Deray and Atchuthan 2018, equations 172 to 174). It
starts at zero and is learned from the same loss as the scene, as BARF does (Lin et al. 2021).

The scene may turn, shift and grow with all cameras at once without any picture changing. Those seven directions are
taken out of the twists once an epoch (to first order), so that cameras which are not learned stay where they belong.

A held-out camera has no twist of its own, for that would take its pixels: it gets the one between its neighbours in
time, which corrects what drifts slowly, as errors of a reconstruction do, and nothing else.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from aa4d.capture.frame import ModelFrame
from aa4d.capture.reader import Capture
from aa4d.methods.settings import Decay
from aa4d.raster.types import Camera
from aa4d.training.per_view import PerView

SMALL = 1e-6  # squared radians, below which the exponential map's coefficients are their series


def exponential(twist: Tensor) -> Tensor:
    """Rigid motions [..., 4, 4] of twists [..., 6] (omega, v); smooth at zero, to the second derivative."""
    omega, v = twist[..., :3], twist[..., 3:]
    squared = (omega * omega).sum(-1)[..., None, None]
    # The square root has no derivative at zero: where the series holds, it is not touched.
    is_small = squared < SMALL
    safe = torch.where(is_small, torch.ones_like(squared), squared)
    angle = safe.sqrt()
    a = torch.where(is_small, 1 - squared / 6, angle.sin() / angle)
    b = torch.where(is_small, 0.5 - squared / 24, (1 - angle.cos()) / safe)
    c = torch.where(is_small, 1 / 6 - squared / 120, (angle - angle.sin()) / (safe * angle))
    K = cross_matrix(omega)
    identity = torch.eye(3, dtype=twist.dtype, device=twist.device)
    rotation = identity + a * K + b * (K @ K)
    translation = (identity + b * K + c * (K @ K)) @ v[..., None]
    bottom = twist.new_tensor([0.0, 0.0, 0.0, 1.0]).expand(*twist.shape[:-1], 1, 4)
    return torch.cat([torch.cat([rotation, translation], -1), bottom], -2)


def cross_matrix(omega: Tensor) -> Tensor:
    """[..., 3, 3] with cross_matrix(a) @ b = a x b."""
    x, y, z = omega.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*omega.shape[:-1], 3, 3)


def gauge_directions(viewmats: Tensor) -> Tensor:
    """Orthonormal basis [6 N, 7] of the twists that move all cameras [N, 4, 4] as one similarity of the scene does.

    A small motion eta of the world, V Exp(eta), is the twist Ad(V) eta; growth by the factor 1 + s moves a camera by
    s t, with t the translation of V.
    """
    rotation, translation = viewmats[:, :3, :3].double(), viewmats[:, :3, 3].double()
    columns = torch.zeros(len(viewmats), 6, 7, dtype=torch.float64, device=viewmats.device)
    columns[:, :3, :3] = rotation
    columns[:, 3:, :3] = cross_matrix(translation) @ rotation
    columns[:, 3:, 3:6] = rotation
    columns[:, 3:, 6] = translation
    # Cameras in one place cannot tell growth from a shift: a direction that the others span is none of its own.
    left, singular, _ = torch.linalg.svd(columns.reshape(-1, 7), full_matrices=False)
    return left[:, singular > 1e-6 * singular[0]]


class PoseRefinement(PerView):
    """The twists of the training cameras."""

    part, name = "poses", "twists"

    def __init__(self, cameras: Sequence[Camera], rate: Decay) -> None:
        viewmats = torch.stack([camera.viewmat for camera in cameras])
        super().__init__(torch.zeros(len(cameras), 6, device=viewmats.device), rate)
        self._gauge = gauge_directions(viewmats)

    def camera(self, index: int, camera: Camera) -> Camera:
        """`camera`, the training camera of that index, where it is thought to stand now; carries gradients."""
        return dataclasses.replace(camera, viewmat=exponential(self.of_views[index]) @ camera.viewmat)

    def fix_gauge(self) -> None:
        """Take out what moves all cameras as one."""
        self.set_to(torch.from_numpy(self.values()))

    def values(self) -> NDArray[np.float64]:
        """[N, 6], without what moves all cameras as one."""
        twists = self.stacked().double().flatten()
        free: NDArray[np.float64] = (twists - self._gauge @ (self._gauge.T @ twists)).reshape(-1, 6).cpu().numpy()
        return free


def refined(capture: Capture, frame: ModelFrame, twists: NDArray[np.float64]) -> Capture:
    """The capture with its cameras moved by twists [N, 6] of its training frames; held-out ones by those between."""
    train = capture.of_split("train")
    known = np.array([capture.frames[i].t for i in train])
    frames = []
    for f in capture.frames:
        twist = np.array([np.interp(f.t, known, column) for column in twists.T])
        frames.append(dataclasses.replace(f, viewmat=moved(f.viewmat, twist, frame)))
    return dataclasses.replace(capture, frames=tuple(frames))


def moved(viewmat: NDArray[np.float64], twist: NDArray[np.float64], frame: ModelFrame) -> NDArray[np.float64]:
    """World to camera [4, 4] after a twist that is given in the model's frame: its units are the model's."""
    in_metres = torch.from_numpy(np.concatenate([twist[:3], twist[3:] * frame.unit_m]))
    result: NDArray[np.float64] = exponential(in_metres).numpy() @ viewmat
    return result
