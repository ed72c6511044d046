"""Optical flow between consecutive training frames, both ways, and the flow that a static scene would show."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.motion.ground import project
from aa4d.motion.observations import Observations

LONGEST_PX = 720  # of the pictures that flow is measured in: small ones are doubled, for cars of ten pixels
CLEARLY = 0.7  # of the mismatch
CONSISTENT_PX = 1.0  # forwards and back again

Floats = NDArray[np.float32]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Flow:
    """Of the pairs of consecutive training frames, P = V - 1; pixels, x right and y down."""

    forward: Floats  # [P, H, W, 2] from frame p to p + 1
    backward: Floats  # [P, H, W, 2] from frame p + 1 to p
    forward_error: Floats  # [P, H, W] how far from its start a pixel ends that goes forwards and back
    backward_error: Floats  # [P, H, W]


def measure(observed: Observations, differs: NDArray[np.bool_]) -> Flow:
    """Of the frames as they are; where they differ [V, H, W] from the static scene, of what differs alone if it fits.

    A mover of ten pixels that goes as far between two frames is lost among the ground's texture, unless that is blank.
    """
    height, width = observed.images.shape[1:3]
    scale = float(np.clip(LONGEST_PX / max(height, width), 1.0, 2.0))
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    dis.setFinestScale(0)
    whole = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in observed.images]
    usual = int(np.median(np.stack(whole)))
    alone = [np.where(mask, grey, usual).astype(np.uint8) for grey, mask in zip(whole, differs, strict=True)]
    pairs = max(len(whole) - 1, 0)
    ways = np.zeros((2, pairs, height, width, 2), np.float32)
    errors = np.zeros((2, pairs, height, width), np.float32)
    for p in range(pairs):
        there, back = (_flow(dis, whole[a], whole[b], scale) for a, b in ((p, p + 1), (p + 1, p)))
        there_alone, back_alone = (_flow(dis, alone[a], alone[b], scale) for a, b in ((p, p + 1), (p + 1, p)))
        ways[0, p] = _better(there, back, there_alone, back_alone, whole[p], whole[p + 1], differs[p])
        ways[1, p] = _better(back, there, back_alone, there_alone, whole[p + 1], whole[p], differs[p + 1])
        errors[0, p] = _round_trip(ways[0, p], ways[1, p])
        errors[1, p] = _round_trip(ways[1, p], ways[0, p])
    return Flow(ways[0], ways[1], errors[0], errors[1])


def _flow(dis: cv2.DISOpticalFlow, a: NDArray[np.uint8], b: NDArray[np.uint8], scale: float) -> Floats:
    height, width = a.shape
    a, b = _scaled(a, scale), _scaled(b, scale)
    flow = np.asarray(dis.calc(a, b, np.zeros((*a.shape, 2), np.float32)), np.float32) / scale
    return np.asarray(cv2.resize(flow, (width, height), interpolation=cv2.INTER_AREA), np.float32)


def _better(
    flow: Floats,
    back: Floats,
    alone: Floats,
    back_alone: Floats,
    here: NDArray[np.uint8],
    there: NDArray[np.uint8],
    differs: NDArray[np.bool_],
) -> Floats:
    """[H, W, 2]: `alone` where it is consistent and carries the picture clearly better than `flow`."""
    consistent = _round_trip(alone, back_alone) < CONSISTENT_PX
    lost = _round_trip(flow, back) >= CONSISTENT_PX
    clearly = np.where(lost, 1.0, CLEARLY) * _mismatch(flow, here, there)
    chosen = differs & consistent & (_mismatch(alone, here, there) < clearly)
    return np.where(chosen[..., None], alone, flow).astype(np.float32)


def _mismatch(flow: Floats, here: NDArray[np.uint8], there: NDArray[np.uint8]) -> Floats:
    """[H, W]: the difference of grey levels that a flow leaves, around each pixel."""
    height, width = here.shape
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    carried = cv2.remap(there.astype(np.float32), x + flow[..., 0], y + flow[..., 1], cv2.INTER_LINEAR)
    return np.asarray(cv2.blur(np.abs(carried - here), (5, 5)), np.float32)


def _scaled(grey: NDArray[np.uint8], scale: float) -> NDArray[np.uint8]:
    size = (round(grey.shape[1] * scale), round(grey.shape[0] * scale))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_CUBIC) if scale != 1 else grey)


def _round_trip(there: Floats, back: Floats) -> Floats:
    height, width = there.shape[:2]
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    x, y = x + there[..., 0], y + there[..., 1]
    returned = cv2.remap(back, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    error = np.linalg.norm(there + returned, axis=2)
    outside = (x < 0) | (y < 0) | (x > width - 1) | (y > height - 1)
    return np.where(outside, np.inf, error).astype(np.float32)


def sample(values: NDArray[np.generic], points: Array) -> NDArray[np.float32]:
    """[N, ...]: values [H, W, ...] at points [N, 2] (pixel centres at + 0.5), bilinear."""
    x, y = (points.astype(np.float32) - 0.5).T
    if not len(points):
        return np.zeros((0, *values.shape[2:]), np.float32)
    side = min(len(points), 8192)  # remap takes no picture with a side above 32767
    rows = -(-len(points) // side)
    padded = np.zeros((2, rows * side), np.float32)
    padded[0, : len(points)], padded[1, : len(points)] = x, y
    found = cv2.remap(
        np.asarray(values, np.float32),
        padded[0].reshape(rows, -1),
        padded[1].reshape(rows, -1),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(found.reshape(rows * side, *values.shape[2:])[: len(points)], np.float32)


def static_flow(observed: Observations, a: int, b: int, pixels: Array, depth: NDArray[np.floating]) -> Array:
    """[N, 2]: where points of depth_z [N] at pixels [N, 2] of frame a go by frame b if they stand still."""
    K, view = observed.K, observed.viewmat
    local = np.stack([(pixels[:, 0] - K[0, 2]) / K[0, 0], (pixels[:, 1] - K[1, 2]) / K[1, 1], np.ones(len(pixels))], 1)
    points = (local * np.asarray(depth, np.float64)[:, None] - view[a, :3, 3]) @ view[a, :3, :3]
    return np.asarray(project(points, view[b], K)[0] - pixels)
