"""What every method trains: units that own something, what they share, and what they look like at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from torch import Tensor, nn

from aa4d.anchors.visibility import in_view
from aa4d.motion.groups import Groups
from aa4d.raster.types import Camera, Gaussians


class SceneModel(nn.Module, ABC):
    """N units (anchors, or free Gaussians), each of which is drawn as `per_unit` Gaussians, those of a unit together.

    Growing and pruning edit the tensors that `unit_tensors` names; everything else in the state is shared. Sizes that
    the state's shapes do not tell, such as the degree of spherical harmonics, are buffers.
    """

    per_unit: int

    def __init__(self) -> None:
        super().__init__()
        self.groups: Groups | None = None  # the rigid groups that units ride on; None where nothing rides

    @abstractmethod
    def __len__(self) -> int:
        """N."""

    @abstractmethod
    def unit_tensors(self) -> tuple[str, ...]:
        """Names in the state of the tensors that have a row for each unit."""

    @abstractmethod
    def parameter_groups(self, *, canonical: bool) -> dict[str, list[nn.Parameter]]:
        """What learns, by the name of its learning rate; in a canonical stage without all that deforms."""

    @abstractmethod
    def gaussians(self, t: float | None, camera: Camera, visible: Tensor | None = None) -> Gaussians:
        """What the units (those at `visible` [M], if given) look like to a camera at t in [0, 1].

        At t = None the canonical scene.
        """

    @abstractmethod
    def centers(self, t: float | None) -> Tensor:
        """[N, 3] where the units are at t, model frame."""

    @abstractmethod
    def resting(self, t: float | None) -> Tensor:
        """[N, 3] where the units are at t but for their deformation: what visibility in training goes by."""

    @property
    def device(self) -> torch.device:
        return self.resting(None).device

    @property
    def group(self) -> Tensor | None:
        """[N] int64, the group of each unit, -1 for the world; None where nothing rides."""
        return None

    def present(self, t: float | None) -> Tensor | None:
        """[N] bool: the units that are there at t; None for all."""
        if self.groups is None or self.group is None:
            return None
        return (self.group < 0) | (self.groups.presence(t) > 0)[self.group.clamp_min(0)]

    def visible(self, t: float | None, camera: Camera) -> Tensor:
        """[M] the units that are deformed and decoded for a camera at t, in order.

        In training (`nn.Module.train`) those whose centre lies in the image or its margin: that is quick, and near
        enough for the frames' own cameras. Otherwise all that are there, so that what is drawn decides: close to the
        ground, most of what fills the picture belongs to a unit whose centre lies far outside of it, or behind.
        """
        present = self.present(t)
        if self.training:
            return in_view(self.resting(t), camera, present)
        return torch.arange(len(self), device=self.device) if present is None else present.nonzero()[:, 0]

    def shared_tensors(self) -> list[Tensor]:
        """What "neural size" counts in the field's tables: networks and planes, nothing that a unit owns."""
        owned = self.unit_tensors()
        return [v for name, v in self.state_dict().items() if name not in owned and not name.startswith("groups.")]

    def tensor(self, name: str) -> Tensor:
        """A tensor of the state, by its name there."""
        path, _, leaf = name.rpartition(".")
        value = getattr(self.get_submodule(path), leaf)
        assert isinstance(value, Tensor)
        return value

    def replace_tensor(self, name: str, value: Tensor) -> None:
        """Put another parameter or buffer in the place of one; its number of rows may differ."""
        path, _, leaf = name.rpartition(".")
        setattr(self.get_submodule(path), leaf, value)
