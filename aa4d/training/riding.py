"""Motion in training: tracks are found on the static stage, and anchors are made that ride on them."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from aa4d.anchors.canonical import spacing
from aa4d.capture.frame import ModelFrame
from aa4d.capture.reader import Capture, read_images
from aa4d.capture.truth import boxes_of
from aa4d.errors import InputError
from aa4d.methods.anchor_model import AnchorModel
from aa4d.methods.settings import CommonRates
from aa4d.motion.groups import Groups
from aa4d.motion.observations import Observations
from aa4d.motion.seeding import seeds
from aa4d.motion.sources import SOURCES, followed_boxes
from aa4d.motion.tracks import Tracks
from aa4d.motion.truth import truth_tracks

FloatArray = NDArray[np.float32]


def find(
    source: str,
    capture: Capture,
    static_color: FloatArray,
    static_depth_m: FloatArray,
    earlier: Tracks | None = None,
) -> Tracks:
    """Tracks of the movers that the training frames show.

    Args:
        source: one of `SOURCES`.
        static_color, static_depth_m: [V, H, W, 3] in [0, 1] and [V, H, W] in world units, zero where nothing is: what
            the static stage shows in place of each training frame.
        earlier: of the first look, where this is the second.

    Raises:
        InputError: boxes are asked for, and the capture has none that follow movers.
    """
    return SOURCES[source](capture, observations(capture, static_color, static_depth_m), earlier)


def check_source(source: str, capture: Capture) -> None:
    """Raises InputError where the capture lacks what tracks are to come from, before anything is trained."""
    if source == "truth":
        truth_tracks(capture, capture.of_split("train"))
    elif source == "boxes":
        followed_boxes(capture)
    else:
        boxes_of(capture)


def refuse_idle_rates(rates: CommonRates) -> None:
    """Raises InputError where nothing rides and a rate of what would learn then was set: it would be lost."""
    for name in ("tracks", "heading"):
        if getattr(rates, name) != getattr(CommonRates(), name):
            raise InputError(f"rates.{name}: nothing rides (motion is none), so it has no effect; leave it out")


def observations(capture: Capture, static_color: FloatArray, static_depth_m: FloatArray) -> Observations:
    rank = np.array(capture.of_split("train"))
    frames = [capture.frames[i] for i in rank]
    return Observations(
        images=read_images(capture, rank.tolist()),
        static_color=static_color,
        static_depth_m=static_depth_m,
        viewmat=np.stack([frame.viewmat for frame in frames]),
        K=capture.camera.K,
        t=np.array([frame.t for frame in frames]),
        rank=rank,
        frames=len(capture.frames),
        fps=capture.fps,
    )


def make_groups(tracks: Tracks, frame: ModelFrame) -> Groups:
    """The trajectories in the model's frame; anchors are looked up in the field where their group is at mid-sight."""
    control = tracks.control.copy()
    control[..., :3] = frame.to_model(control[..., :3])
    seen = np.clip(tracks.shown[:, 1:3], 0, 1).mean(axis=1)
    reference = np.stack([tracks.poses(np.array([t]))[g, 0] for g, t in enumerate(seen)])
    reference[:, :3] = frame.to_model(reference[:, :3])
    as_tensor = lambda a: torch.from_numpy(np.ascontiguousarray(a)).float()  # noqa: E731
    return Groups(tracks.names, *(as_tensor(a) for a in (control, reference, tracks.shown, tracks.up)))


def add_riders(
    model: AnchorModel, capture: Capture, tracks: Tracks, frame: ModelFrame, voxel: float, embedding_std: float
) -> None:
    """Append anchors that fill the movers, in voxels of edge `voxel` (model units), and let them ride on the tracks.

    Draws from torch's global generator, on the CPU.
    """
    frames = capture.of_split("train")
    t = np.array([capture.frames[i].t for i in frames])
    viewmats = np.stack([capture.frames[i].viewmat for i in frames])
    centers, group = seeds(tracks, t, viewmats, capture.camera.K, voxel * frame.unit_m)
    centers = centers / frame.unit_m  # a group's frame is turned and shifted, not scaled
    old = model.anchors
    scale = np.concatenate(
        [spacing(centers[group == g], floor=1e-3 * voxel) for g in range(len(tracks)) if (group == g).any()]
        or [np.zeros(0)]
    )
    device = old.position.device
    new = old.more(
        torch.from_numpy(centers).float(),
        torch.from_numpy(np.log(np.minimum(scale, 2 * voxel))).float()[:, None].repeat(1, 6),
        embedding_std,
    ).to(device)
    for name, value in list(old.named_parameters()):
        setattr(old, name, nn.Parameter(torch.cat([value.detach(), getattr(new, name).detach()])))
    old.position = torch.cat([old.position, new.position])
    belongs = torch.cat([torch.full((len(old) - len(group),), -1), torch.from_numpy(group)]).to(device)
    model.ride(make_groups(tracks, frame).to(device), belongs)


def membership_loss(share: Tensor, labels: Tensor, moving: Tensor) -> Tensor:
    """Mean distance of the share of riders that pixels show, [H, W], from 1 on movers and 0 away from them.

    Args:
        labels: [H, W] bool, pixels that show a tracked mover.
        moving: [H, W] bool, pixels that may show one: those outside of `labels` say nothing.
    """
    certain = labels | ~moving
    return ((share - labels.float()).abs() * certain).sum() / certain.sum().clamp_min(1)
