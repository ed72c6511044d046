"""The files that an object can show, as one kind of thing: a model of anchors, and a track of Gaussians."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from . import carriers, groups, names
from .clip import Clip
from .container import Floats, read_metadata
from .field import Field, Indices, prepare
from .header import Doubles
from .knots import Knots, of_clip
from .model import Model, read_model
from .track import FORMAT, Track, read_track

MODEL, TRACK = "MODEL", "TRACK"
Values = dict[names.Attribute, Floats]


class Source(Protocol):
    """A file that is ready to be evaluated at any time.

    It consists of units, one row of the file each; a carrier shows one point or several of each.
    """

    @property
    def kind(self) -> str:
        """MODEL or TRACK."""

    @property
    def clip(self) -> Clip:
        """What it was trained on."""

    @property
    def model(self) -> Model | None:
        """Anchors, the field that moves them, and trajectories of vehicles; a track has none of these."""

    @property
    def known_carriers(self) -> tuple[str, ...]:
        """What points can stand for; the first has one point a unit."""

    @property
    def offers(self) -> Collection[names.Attribute]:
        """What it can say of its points."""

    @property
    def unit_count(self) -> int:
        """How many units there are."""

    @property
    def group_of_unit(self) -> Indices | None:
        """The vehicle [units] that each belongs to, -1 for the world; None where no vehicles are known."""

    @property
    def reach(self) -> Doubles:
        """The largest distance [3] of a unit from the origin along each axis, metres."""

    def points_each(self, carrier: str) -> int:
        """How many points of the carrier there are to a unit."""

    def there(self, t: float) -> npt.NDArray[np.bool_]:
        """Whether each unit is in the scene at t: [units]."""

    def evaluate(
        self, carrier: str, t: float, eye: Doubles, wanted: Collection[names.Attribute], *, quick: bool = False
    ) -> Values:
        """The attributes at t, one row a point, seen from `eye` [3], metres: `names.APPEARANCE`, and what is wanted and
        offered of the others. `quick` allows what `knots` leaves out.

        Raises:
            ModelFileError: the numbers of the file overflow there.
        """

    def color_errors(self, t: float, eye: Doubles, values: Values) -> tuple[float, float] | None:
        """By how much colours of `values`, evaluated with harmonics for these, are off as the held-out cameras see
        them: with the harmonics, and without. None where there are no such cameras."""

    def positions(self, carrier: str, t: float) -> Floats:
        """Places [points, 3] alone, world metres: for trails."""

    def chord_error_m(self, times: Sequence[float]) -> float:
        """How far a vehicle is, at most, from the straight way between two of these times, metres."""


@dataclass(frozen=True)
class ModelSource:
    """The anchors of a model, or their local Gaussians."""

    kind: ClassVar[str] = MODEL
    known_carriers: ClassVar[tuple[str, ...]] = (names.ANCHORS, names.GAUSSIANS)
    offers: ClassVar[Collection[names.Attribute]] = (
        *names.APPEARANCE,
        *names.SHAPE,
        *names.INSPECTION,
        *names.HARMONICS,  # of the local Gaussians
    )

    field: Field
    knots: Knots | None = None  # for quick frames; without them those are exact

    @property
    def model(self) -> Model:
        """The model."""
        return self.field.model

    @property
    def clip(self) -> Clip:
        """What it was trained on."""
        return self.field.model

    @property
    def unit_count(self) -> int:
        """How many anchors there are."""
        return self.model.anchor_count

    @property
    def group_of_unit(self) -> Indices | None:
        """The vehicle [N] that each anchor rides on."""
        return None if self.model.groups is None else self.model.groups.of_anchor

    @property
    def reach(self) -> Doubles:
        """Of the canonical anchors, and of the control points of vehicles."""
        places = self.model.tensors["anchors.position"]
        if self.model.groups is not None:  # a rider's place counts from its group's
            places = np.concatenate([places, self.model.groups.control[..., :3].reshape(-1, 3)])
        return np.abs(self.model.scale * places + self.model.translation).max(axis=0)

    def points_each(self, carrier: str) -> int:
        """K for the local Gaussians, 1 for the anchors themselves."""
        return carriers.points_per_anchor(self.field, carrier)

    def there(self, t: float) -> npt.NDArray[np.bool_]:
        """Whether the anchor's vehicle is shown; the world is always there."""
        shown = self.model.groups
        if shown is None or self.model.static:
            return np.ones(self.unit_count, bool)
        return np.append(shown.presence(t) > 0, True)[shown.of_anchor]

    def evaluate(
        self, carrier: str, t: float, eye: Doubles, wanted: Collection[names.Attribute], *, quick: bool = False
    ) -> Values:
        """See `carriers.evaluate`."""
        return carriers.evaluate(self.field, carrier, t, eye, wanted, self.knots if quick else None)

    def color_errors(self, t: float, eye: Doubles, values: Values) -> tuple[float, float] | None:
        """See `sights.color_errors`."""
        return carriers.color_errors(self.field, t, eye, values)

    def positions(self, carrier: str, t: float) -> Floats:
        """See `carriers.positions`."""
        return carriers.positions(self.field, carrier, t)

    def chord_error_m(self, times: Sequence[float]) -> float:
        """Of the anchors that ride; 0 without vehicles."""
        model = self.model
        if model.groups is None or model.static:
            return 0.0
        return model.scale * groups.chord_error(model.groups, model.tensors["anchors.position"], times)


@dataclass(frozen=True)
class TrackSource:
    """The Gaussians of a track, in the colours of its export, wherever they are seen from."""

    kind: ClassVar[str] = TRACK
    model: ClassVar[None] = None
    known_carriers: ClassVar[tuple[str, ...]] = (names.GAUSSIANS,)
    offers: ClassVar[Collection[names.Attribute]] = (
        *names.APPEARANCE,
        *names.SHAPE,
        names.DISPLACEMENT,
        names.SPEED,
    )

    track: Track

    @property
    def clip(self) -> Clip:
        """What the model was trained on."""
        return self.track

    @property
    def unit_count(self) -> int:
        """How many Gaussians there are."""
        return len(self.track.ids)

    @property
    def group_of_unit(self) -> Indices | None:
        """The vehicle [N] of each Gaussian."""
        return self.track.group

    @property
    def reach(self) -> Doubles:
        """Over all keys."""
        return self.track.channels["position"].largest.astype(np.float64)

    def points_each(self, carrier: str) -> int:  # noqa: ARG002 - there is one carrier
        """A Gaussian is a point."""
        return 1

    def there(self, t: float) -> npt.NDArray[np.bool_]:
        """Whether it has any opacity."""
        return self.track.opacities_at(t) > 0

    @np.errstate(over="ignore", invalid="ignore")  # what overflows is found below
    def evaluate(
        self,
        carrier: str,  # noqa: ARG002 - there is one
        t: float,
        eye: Doubles,  # noqa: ARG002 - the export has baked what each of its views sees
        wanted: Collection[names.Attribute],
        *,
        quick: bool = False,  # noqa: ARG002 - it is
    ) -> Values:
        """Displacement counts from the first key: a track knows no canonical place."""
        now = self.track.at(t)
        values = {
            names.POSITION: now.positions,
            names.COLOR: carriers.linear_rgba(now.colors),
            names.OPACITY: now.opacities,
            names.RADIUS: carriers.radius(now.scales),
            names.SCALE: now.scales,
            names.ROTATION: now.quaternions,
        }
        carriers.hide_absent(values, now.opacities > 0)
        if names.DISPLACEMENT in wanted:
            values[names.DISPLACEMENT] = np.linalg.norm(now.positions - self.track.positions_at(0.0), axis=1)
        if names.SPEED in wanted:
            values[names.SPEED] = carriers.mean_speed(self.track, t, self.track.positions_at)
        carriers.check_finite(values, self.track, t)
        return values

    def color_errors(self, t: float, eye: Doubles, values: Values) -> tuple[float, float] | None:  # noqa: ARG002
        """Its colours are the same from everywhere."""
        return None

    def positions(self, carrier: str, t: float) -> Floats:  # noqa: ARG002 - there is one
        """The centres."""
        return self.track.positions_at(t)

    def chord_error_m(self, times: Sequence[float]) -> float:  # noqa: ARG002
        """It has no trajectories of vehicles, and moves straight between its own keys."""
        return 0.0


def read_source(path: str) -> Source:
    """The file, of whichever format it says it is; one that says neither is refused as a model.

    Raises:
        ModelFileError: as `read_model`, `prepare` and `read_track`.
    """
    if _format(read_metadata(Path(path))) == FORMAT:
        return TrackSource(read_track(path))
    field = prepare(read_model(path))
    return ModelSource(field, of_clip(field.model.frame_count))


def _format(metadata: Mapping[str, str]) -> object:
    try:
        information = json.loads(metadata["aa4d"])
    except (KeyError, ValueError, RecursionError):
        return None
    return information.get("format") if isinstance(information, dict) else None


def point_count(source: Source, carrier: str) -> int:
    """How many points the carrier has."""
    return source.unit_count * source.points_each(carrier)
