"""What a method is to training, evaluation and files: one object, made of small parts that each does for itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic

import torch
from numpy.typing import NDArray
from torch import Tensor

from aa4d.anchors.densification import Statistics
from aa4d.methods.rendering import Rendered
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.settings import Settings
from aa4d.raster.types import Camera, Output


@dataclass(frozen=True)
class Stage:
    """A part of training. `draws` numbers its random choices apart from those of other stages."""

    name: str
    iterations: int
    draws: int
    canonical: bool = False  # nothing moves: drawn at no time
    views_per_step: int = 1
    changes_units: bool = True  # units come and go
    spans: tuple[tuple[float, float], ...] = ()  # of t, whose frames it looks at; where none is given, at all
    decay: tuple[float, float] = (0.0, 1.0)  # how far the learning rates' decay is at its first and last iteration

    def progress(self, iteration: int) -> float:
        """Of the learning rates' decay at an iteration, from 0."""
        begin, end = self.decay
        return begin + (end - begin) * iteration / max(self.iterations - 1, 1)

    def looks_at(self, t: float) -> bool:
        return not self.spans or any(start <= t <= end for start, end in self.spans)


@dataclass(frozen=True)
class Beginning:
    """What a model starts from, in the model's frame."""

    points: NDArray[Any]  # [P, 3] float64
    colors: NDArray[Any]  # [P, 3] uint8 sRGB
    frames: int  # of the clip, held-out ones too
    seconds: float  # from the first frame to the last
    pixel: float  # width of a pixel at unit depth
    times: tuple[float, ...] = ()  # of the training frames, in order


@dataclass(frozen=True)
class Look:
    """A training view without its picture."""

    t: float
    camera: Camera
    background: Tensor  # [3]


Looks = Callable[[], list[Look]]  # gathers all training views; asked for rarely


@dataclass(frozen=True)
class UnitEdit:
    """Units that stay, and new ones: each tensor of a new unit is its parent's where `values` has no other."""

    keep: Tensor  # [K] int64
    parent: Tensor  # [M] int64
    values: dict[str, Tensor] = field(default_factory=dict)  # [M, ...] by the tensor's name in the state
    anew: dict[str, Tensor] = field(default_factory=dict)  # [K, ...] of those that stay; their moments begin anew


class Method(ABC, Generic[Settings]):
    """One entry of `aa4d.methods.METHODS`. Settings are the method's own dataclass; nothing here keeps any state."""

    name: str
    presets: Mapping[str, Settings]

    @abstractmethod
    def resolved(self, settings: Settings, frames: int) -> Settings:
        """The settings with all that depends on the number of frames filled in."""

    @abstractmethod
    def stages(self, settings: Settings) -> tuple[Stage, ...]:
        """In order; the canonical ones come first. Training adds those of motion."""

    @abstractmethod
    def initial(self, settings: Settings, beginning: Beginning) -> SceneModel:
        """A model on the CPU, drawn from `settings.seed` alone."""

    @abstractmethod
    def blank(self, settings: Settings, units: int) -> SceneModel:
        """A model of the right shapes, to load a checkpoint into."""

    def enter(self, stage: Stage, model: SceneModel, settings: Settings) -> None:
        """Whatever a stage needs before its first iteration; it happens once, before the checkpoint that starts it."""

    def begin_step(self, stage: Stage, iteration: int, model: SceneModel, settings: Settings) -> None:
        """What changes by itself as training goes on; before iteration `iteration` of the stage, from 0."""

    def trained_time(self, stage: Stage, iteration: int, t: float, views: int, settings: Settings) -> float:  # noqa: ARG002
        """The time in place of `t` at which one of `views` training views is drawn to be learned from."""
        return t

    def outputs(self, settings: Settings) -> Collection[Output]:  # noqa: ARG002
        """What growing asks the rasteriser for besides."""
        return ()

    @abstractmethod
    def image_loss(self, rendered: Rendered, target: Tensor, settings: Settings) -> tuple[Tensor, Tensor]:
        """The loss of one view, and its mean squared error. target [H, W, 3]."""

    def penalty(self, stage: Stage, model: SceneModel, settings: Settings) -> Tensor | None:  # noqa: ARG002
        """What a step pays besides, whatever it shows."""
        return None

    def observe(
        self,
        statistics: Statistics,
        rendered: Rendered,
        views: int,
        settings: Settings,  # noqa: ARG002
    ) -> None:
        """Note of a view what units come and go by, after the backward pass of a step of so many views."""
        statistics.add(rendered.visible, rendered.gaussians, rendered.rendering, views)

    @abstractmethod
    def edit(
        self,
        model: SceneModel,
        statistics: Statistics,
        settings: Settings,
        pixel: float,
        generator: torch.Generator,
    ) -> UnitEdit:
        """Which units go and which come, by `statistics`, of which the judged ones start anew.

        Args:
            pixel: its width at unit depth, model frame.
            generator: on the CPU, so that every device draws alike.
        """

    def revise(self, stage: Stage, done: int, model: SceneModel, settings: Settings, looks: Looks) -> UnitEdit | None:  # noqa: ARG002
        """What else changes of the units, by a schedule of the method's own; after any growth.

        Args:
            done: iterations of the stage so far, from 1.
            looks: every training view.
        """
        return None

    # The model file: what its header says of the configuration, and how its tensors are called and laid out.

    @abstractmethod
    def header(self, model: SceneModel) -> dict[str, Any]:
        """What of a model's configuration stands in the model file's header."""

    @abstractmethod
    def blank_of_file(self, config: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> SceneModel:
        """A model of the right shapes for a file, without groups.

        Args:
            config: what `header` wrote, unchecked.

        Raises:
            InputError: names `path` and what is wrong in it.
        """

    def file_name(self, name: str) -> str:
        """A tensor's name in the file for its name in the state."""
        return name

    def to_file(self, name: str, value: Tensor) -> Tensor:  # noqa: ARG002
        """A tensor of the state as the file has it: float32."""
        return value.float()

    def from_file(self, name: str, value: Tensor) -> Tensor:  # noqa: ARG002
        return value

    def check(self, model: SceneModel, path: Path) -> None:
        """Raises InputError for a model that was read whole, and that no training could have written."""
