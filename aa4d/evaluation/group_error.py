"""Distance of rigid groups from the instances that they stand for, at times that training never saw."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from aa4d.capture.reader import Capture
from aa4d.evaluation.true_motion import TrueTracks
from aa4d.evaluation.views import view_of_frame
from aa4d.methods.model_file import LoadedModel
from aa4d.methods.rendering import render
from aa4d.motion.groups import Groups

MATCHED_ON = 16  # training frames at most, evenly over the clip
AT_ONCE = 32  # groups drawn in one pass: what the rasteriser takes
MOSTLY = 0.5  # fraction of a pixel's color: so much comes from a group, and the pixel is the group's
FEWEST_PX = 20  # pixels of an instance in a frame: with fewer it does not count there

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GroupError:
    errors_m: Array  # [E] one for each matched group and held-out frame in which both can be seen
    matched: int  # moving instances that have a group


def group_pixels(
    loaded: LoadedModel,
    capture: Capture,
    instances: int,
    instance_of: Callable[[int], NDArray[np.int64] | None],
    progress: Callable[[], None],
) -> NDArray[np.int64]:
    """[G, M] pixels of the training frames in which group g is drawn on instance m.

    Args:
        instances: M.
        instance_of: rows of what the pixels of a frame show, [H, W], -1 for none; None without truth.
        progress: called after each frame.
    """
    assert loaded.model.groups is not None
    count = len(loaded.model.groups)
    votes = np.zeros((count, instances), np.int64)
    for index in match_frames(capture):
        instance = instance_of(index)
        if instance is not None:
            for group in range(0, count, AT_ONCE):
                members = _shares(loaded, capture, index, range(group, min(group + AT_ONCE, count))) > MOSTLY
                for row, mask in enumerate(members):
                    on = instance[mask]
                    votes[group + row] += np.bincount(on[on >= 0], minlength=instances)
        progress()
    return votes


def match_frames(capture: Capture) -> list[int]:
    """The training frames that groups and instances are matched on."""
    training = capture.of_split("train")
    chosen = np.linspace(0, len(training) - 1, min(MATCHED_ON, len(training))).round().astype(int)
    return [training[i] for i in chosen]


def _shares(loaded: LoadedModel, capture: Capture, index: int, groups: range) -> NDArray[np.float32]:
    """[g, H, W] the part of each pixel's colour that comes from each of `groups`, the background counted."""
    member = loaded.model.group
    assert member is not None
    wanted = torch.arange(groups.start, groups.stop, device=member.device)
    with torch.no_grad():
        drawn = render(
            loaded.model,
            *view_of_frame(loaded, capture, index),
            unit_features=(member[:, None] == wanted).float(),
        ).rendering
    assert drawn.features is not None
    return drawn.features.permute(2, 0, 1).cpu().numpy()


def match(votes: NDArray[np.int64]) -> dict[int, int]:
    """Group by instance: a group stands for the instance that it is drawn on most, an instance has the largest such.

    Args:
        votes: [G, M] pixels.
    """
    found: dict[int, int] = {}
    if not votes.size:
        return found
    for group, instance in enumerate(votes.argmax(axis=1)):
        pixels = votes[group, instance]
        if pixels > 0 and (instance not in found or pixels > votes[found[int(instance)], instance]):
            found[int(instance)] = group
    return found


def group_error(
    loaded: LoadedModel,
    groups: Groups,
    capture: Capture,
    tracks: TrueTracks,
    votes: NDArray[np.int64],
    visible_px: NDArray[np.int64],
) -> GroupError:
    """Distance between T_g(t) and where the instance carries the group, at held-out times.

    A group's origin may lie anywhere on its instance: its place in the instance's frame, the median over the training
    times at which both can be seen, is what the instance should carry.

    Args:
        votes: [G, M] from `group_pixels`.
        visible_px: [N, M] pixels of the instances in the frames.
    """
    moves = (tracks.moving & (visible_px >= FEWEST_PX)).any(axis=0)  # [M]
    found = match(np.where(moves[None], votes, 0))
    times = [frame.t for frame in capture.frames]
    with torch.no_grad():
        position = np.stack([groups.pose(t).position.double().cpu().numpy() for t in times])  # [N, G, 3]
        shown = np.stack([groups.presence(t).cpu().numpy() > 0 for t in times])
    world = position * loaded.frame.unit_m + loaded.frame.origin_m
    held_out = np.array([frame.split == "test" for frame in capture.frames])
    errors: list[float] = []
    for instance, group in found.items():
        to_object = np.linalg.inv(tracks.poses[:, instance])
        own = np.einsum("nij,nj->ni", to_object[:, :3, :3], world[:, group]) + to_object[:, :3, 3]
        both = shown[:, group] & tracks.present[:, instance] & (visible_px[:, instance] >= FEWEST_PX)
        if (both & ~held_out).any():
            carried = np.median(own[both & ~held_out], axis=0)
            errors += np.linalg.norm(own[both & held_out] - carried, axis=1).tolist()
    return GroupError(np.array(errors), len(found))
