"""Toy models for exports, and splat files drawn as a viewer draws them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from plyfile import PlyData

from aa4d.evaluation.views import as_picture
from aa4d.export.harmonics import SH_CONSTANT
from aa4d.filming.camera_path import View
from aa4d.methods.model_file import LoadedModel, load_model
from aa4d.motion.tracks import ALWAYS
from aa4d.raster import rasterize
from aa4d.raster.types import Camera, Gaussians
from tests.toy_riders import ride


def read_splats(path: Path) -> Gaussians:
    """As a splat viewer decodes the file."""
    vertex = PlyData.read(str(path))["vertex"]

    def columns(*names: str) -> torch.Tensor:
        return torch.from_numpy(np.stack([np.asarray(vertex[n], np.float32) for n in names], axis=1))

    return Gaussians(
        means=columns("x", "y", "z"),
        quaternions=columns("rot_0", "rot_1", "rot_2", "rot_3"),
        scales=columns("scale_0", "scale_1", "scale_2").exp(),
        opacities=torch.sigmoid(columns("opacity"))[:, 0],
        colors=(0.5 + SH_CONSTANT * columns("f_dc_0", "f_dc_1", "f_dc_2")).clamp(0, 1),
    )


def seen_in_metres(gaussians: Gaussians, loaded: LoadedModel, view: View, turn: NDArray[np.float64]) -> NDArray:
    """The view's picture of Gaussians that live in metres, in a world turned by `turn`."""
    pinhole, viewmat = loaded.camera, view.viewmat.copy()
    viewmat[:3, :3] = viewmat[:3, :3] @ turn.T
    camera = Camera(
        torch.from_numpy(viewmat).float(), torch.from_numpy(pinhole.K).float(), pinhole.width, pinhole.height, near=0.2
    )
    return as_picture(rasterize(gaussians, camera, background=torch.tensor(loaded.background)).color)


def riding(toy_run: Path) -> LoadedModel:
    """The first third of the anchors rides with the square, the second on a group that leaves at t = 0.5."""
    loaded = load_model(toy_run / "model.safetensors")
    n = len(loaded.model.anchors)
    group = torch.full((n,), -1)
    group[: n // 3], group[n // 3 : 2 * n // 3] = 0, 1
    ride(loaded, group, shown=(ALWAYS, (-2, -1, 0.4, 0.5)))
    return loaded


def left_out(loaded: LoadedModel) -> LoadedModel:
    """The model of a film of whose frames some were left out: the first five a second apart, then a gap of six."""
    seconds = [0.0, 1.0, 2.0, 3.0, 4.0, 10.0, 11.0, 12.0, 12.5, 15.0]
    frames = tuple(replace(f, time_s=s) for f, s in zip(loaded.frames, seconds, strict=True))
    return replace(loaded, frames=frames)
