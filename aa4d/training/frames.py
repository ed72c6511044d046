"""A capture's training frames, ready to be learned from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from aa4d.capture.frame import ModelFrame, frame_of
from aa4d.capture.reader import Capture, read_images
from aa4d.capture.truth import LEFT_OUT, depth_of, left_out
from aa4d.errors import InputError
from aa4d.methods.contract import Beginning
from aa4d.raster.types import Camera


@dataclass(frozen=True)
class View:
    """One training frame."""

    t: float
    camera: Camera
    pixels: Tensor  # [H, W, 3] uint8
    left_out: Tensor | None = None  # [H, W] pixels that the loss does not see
    depth: Tensor | None = None  # [H, W] true depth_z in model units, infinite where there is none

    def target(self) -> Tensor:
        return self.pixels.float() / 255


@dataclass(frozen=True)
class TrainingFrames:
    capture: Capture
    frame: ModelFrame
    views: tuple[View, ...]
    # What no unit covers shows the mean color of the training frames: the least wrong constant.
    background: Tensor  # [3]
    pixel: float  # its width at unit depth
    device: torch.device

    def beginning(self) -> Beginning:
        c = self.capture
        times = tuple(view.t for view in self.views)
        seconds = c.frames[-1].time_s - c.frames[0].time_s
        return Beginning(self.frame.to_model(c.points), c.point_colors, len(c.frames), seconds, self.pixel, times)


def training_frames(
    capture: Capture, device: torch.device, *, with_masks: bool = False, with_depth: bool = False
) -> TrainingFrames:
    """Every training frame is read here.

    Args:
        with_masks: read the pixels that are to be left out.
        with_depth: read the true depth.

    Raises:
        InputError: a frame, a mask or a depth cannot be read, or is asked for and nowhere there.
    """
    frame, c = frame_of(capture), capture.camera
    indices = capture.of_split("train")
    images = torch.from_numpy(read_images(capture, indices))
    masks = _masks(capture, indices) if with_masks else {}
    depths = _depths(capture, indices, frame.unit_m) if with_depth else {}
    views = tuple(
        View(
            capture.frames[i].t,
            frame.camera(capture.frames[i].viewmat, c.K, c.width, c.height, device),
            image.to(device),
            masks[i].to(device) if i in masks else None,
            depths[i].to(device) if i in depths else None,
        )
        for i, image in zip(indices, images, strict=True)
    )
    background = (images.float().mean(dim=(0, 1, 2)) / 255).to(device)
    return TrainingFrames(capture, frame, views, background, 1 / float(c.K[0, 0]), device)


def _masks(capture: Capture, indices: list[int]) -> dict[int, Tensor]:
    found = {i: mask for i in indices if (mask := left_out(capture, i)) is not None}
    if not found:
        raise InputError(
            f"{capture.folder / LEFT_OUT}: no training frame has a mask there; paint NAME.png, or all.png for all "
            "frames, white where pixels are to be left out, or train without leave_out"
        )
    return {i: torch.from_numpy(mask) for i, mask in found.items()}


def _depths(capture: Capture, indices: list[int], unit_m: float) -> dict[int, Tensor]:
    found = {i: depth for i in indices if (depth := depth_of(capture, i)) is not None}
    if len(found) < len(indices):
        raise InputError(f"{capture.folder}: has no true depth of all training frames; train without true_depth")
    return {i: torch.from_numpy(depth / np.float32(unit_m)) for i, depth in found.items()}
