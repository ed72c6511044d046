"""What a run knows of movers: their tracks, when they are found, and what a step makes of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from aa4d.errors import InputError
from aa4d.methods.anchor_model import AnchorModel
from aa4d.methods.rendering import Rendered, render
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.settings import AnchorSettings, MotionSettings, RunSettings
from aa4d.motion.tracks import Tracks
from aa4d.motion.tracks_file import load_tracks, movers_path, save_tracks, tracks_path
from aa4d.motion.truth import truth_tracks
from aa4d.training.exposures import Exposures
from aa4d.training.frames import TrainingFrames
from aa4d.training.riding import FloatArray, add_riders, find, membership_loss
from aa4d.training.spent import Spent

RESTART = "delete the run and train again"


class Movers:
    """The tracks of one run with motion, and what training makes of them."""

    def __init__(self, settings: MotionSettings, frames: TrainingFrames, out: Path) -> None:
        self.settings = settings
        self.tracks: Tracks | None = None  # once they are known
        self._frames = frames
        self._out = out

    def know(self, model: SceneModel, *, moving: bool, clean: bool) -> None:
        """Tracks that a stage depends on, before it starts or continues: one that moves, or the clean one."""
        if moving:
            path = tracks_path(self._out)
            self.tracks = self._own(path)
            if (() if model.groups is None else model.groups.names) != self.tracks.names:
                raise InputError(f"{path}: is of another run than the checkpoint beside it; {RESTART}")
        elif clean:
            self.tracks = self._own(movers_path(self._out))
        elif not self.settings.needs_static:
            capture = self._frames.capture
            self.tracks = truth_tracks(capture, capture.of_split("train"))

    def _own(self, path: Path) -> Tracks:
        tracks, c = load_tracks(path), self._frames.capture.camera
        if tracks.labels.shape != (len(self._frames.views), c.height, c.width):
            raise InputError(f"{path}: holds tracks of another capture; {RESTART}")
        return tracks

    def look(self, model: SceneModel, exposures: Exposures | None, stage: str, say: Callable[[str], None]) -> Spent:
        """Find them against the static scene, the second time with what the first look found; returns its time."""
        started = Spent.clocks()
        say(f"looking for movers in {len(self._frames.views)} frames")
        views = static_views(model, self._frames, exposures)
        self.tracks = find(self.settings.tracks, self._frames.capture, *views, self.tracks)
        spent = Spent.clocks().since(started)
        say(f"tracks of movers after the {stage} stage: {len(self.tracks)}, in {spent.seconds:.0f} s")
        return spent

    def keep_first_look(self) -> None:
        assert self.tracks is not None
        save_tracks(movers_path(self._out), self.tracks)

    def ride(self, model: SceneModel, settings: RunSettings, say: Callable[[str], None]) -> None:
        """Keep the tracks, and let anchors ride on them."""
        assert self.tracks is not None
        assert isinstance(model, AnchorModel)
        assert isinstance(settings, AnchorSettings)
        if not len(self.tracks):
            say("no mover was found: no anchor rides")
        save_tracks(tracks_path(self._out), self.tracks)
        if len(self.tracks):
            torch.manual_seed(settings.seed)
            voxel = self.settings.voxel_px * self._frames.pixel
            add_riders(model, self._frames.capture, self.tracks, self._frames.frame, voxel, settings.embedding_std)

    def moving(self, index: int) -> Tensor:
        """[H, W] bool: pixels of a view that may show a mover."""
        assert self.tracks is not None
        return torch.from_numpy(self.tracks.moving[index]).to(self._frames.device)

    def membership(self, model: SceneModel) -> Tensor | None:
        """[N, 1] what is drawn to compare riders with the movers' masks: 1 for a unit that rides."""
        if self.settings.membership == 0 or model.group is None:
            return None
        return (model.group >= 0).float()[:, None]

    def loss(self, rendered: Rendered, index: int) -> Tensor | None:
        """Of the share of riders that a view shows; None where it was not drawn."""
        share = rendered.rendering.features
        if share is None or self.tracks is None:
            return None
        labels = torch.from_numpy(self.tracks.labels[index] > 0).to(self._frames.device)
        return self.settings.membership * membership_loss(share[..., 0], labels, self.moving(index))

    def resting(self, iteration: int, total: int) -> tuple[str, ...]:
        """Parameter groups that do not learn yet."""
        return ("tracks", "heading") if iteration < self.settings.learn_from * total else ()

    def bound(self, model: SceneModel) -> None:
        if model.groups is not None:
            model.groups.bound(self.settings.farthest_px * self._frames.pixel, self.settings.largest_turn)


@torch.no_grad()
def static_views(
    model: SceneModel, frames: TrainingFrames, exposures: Exposures | None = None
) -> tuple[FloatArray, FloatArray]:
    """What the static scene shows in place of the training frames: color [V, H, W, 3], depth_z in world units."""
    color, depth = [], []
    for index, view in enumerate(frames.views):
        rendered = render(model, None, view.camera, frames.background, outputs=["depth"])
        rendering = (rendered if exposures is None else exposures.of(index, rendered)).rendering
        assert rendering.depth is not None
        color.append(rendering.color.clamp(0, 1).cpu().numpy())
        depth.append(rendering.depth.cpu().numpy() * np.float32(frames.frame.unit_m))
    return np.stack(color), np.stack(depth)
