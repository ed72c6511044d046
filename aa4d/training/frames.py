"""A capture's training frames, ready to be learned from."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from aa4d.capture.frame import ModelFrame, frame_of
from aa4d.capture.reader import Capture, read_images
from aa4d.methods.contract import Beginning
from aa4d.raster.types import Camera


@dataclass(frozen=True)
class View:
    """One training frame."""

    t: float
    camera: Camera
    pixels: Tensor  # [H, W, 3] uint8

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


def training_frames(capture: Capture, device: torch.device) -> TrainingFrames:
    """Every training frame is read here. Raises InputError for one that cannot be."""
    frame, c = frame_of(capture), capture.camera
    indices = capture.of_split("train")
    images = torch.from_numpy(read_images(capture, indices))
    views = tuple(
        View(
            capture.frames[i].t,
            frame.camera(capture.frames[i].viewmat, c.K, c.width, c.height, device),
            image.to(device),
        )
        for i, image in zip(indices, images, strict=True)
    )
    background = (images.float().mean(dim=(0, 1, 2)) / 255).to(device)
    return TrainingFrames(capture, frame, views, background, 1 / float(c.K[0, 0]), device)
