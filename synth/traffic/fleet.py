"""Kinds of road users and their sizes."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["hatchback", "saloon", "suv", "van", "bus", "truck", "cyclist", "pedestrian"]
DrivenKind = Literal["hatchback", "saloon", "suv", "van", "bus", "truck", "cyclist"]


@dataclass(frozen=True)
class Body:
    """Outer dimensions in metres, and the class that captures and exports call it by."""

    length_m: float
    width_m: float
    height_m: float
    wheelbase_m: float
    label: Literal["car", "van", "bus", "truck", "bicycle", "pedestrian"] = "car"

    @property
    def dimensions_m(self) -> tuple[float, float, float]:
        return self.length_m, self.width_m, self.height_m


BODIES: dict[str, Body] = {
    "hatchback": Body(4.05, 1.78, 1.48, 2.55),
    "saloon": Body(4.65, 1.84, 1.45, 2.80),
    "suv": Body(4.70, 1.92, 1.70, 2.75),
    "van": Body(5.30, 2.00, 2.25, 3.20, "van"),
    "bus": Body(12.00, 2.55, 3.05, 5.90, "bus"),
    "truck": Body(8.60, 2.50, 3.40, 4.80, "truck"),
    "cyclist": Body(1.80, 0.60, 1.75, 1.05, "bicycle"),
    "pedestrian": Body(0.50, 0.55, 1.75, 0.20, "pedestrian"),
}

# Linear RGB of common paints, and how often each is drawn.
Paint = tuple[float, float, float]
PAINTS: tuple[tuple[Paint, float], ...] = (
    ((0.80, 0.80, 0.78), 0.22),  # white
    ((0.42, 0.44, 0.46), 0.17),  # silver
    ((0.015, 0.016, 0.018), 0.16),  # black
    ((0.10, 0.11, 0.12), 0.14),  # grey
    ((0.45, 0.02, 0.02), 0.11),  # red
    ((0.02, 0.07, 0.32), 0.11),  # blue
    ((0.03, 0.14, 0.08), 0.04),  # green
    ((0.65, 0.38, 0.03), 0.05),  # yellow
)
LIVERIES: tuple[tuple[Paint, float], ...] = (
    ((0.50, 0.03, 0.03), 0.4),
    ((0.75, 0.75, 0.70), 0.25),
    ((0.65, 0.45, 0.04), 0.2),
    ((0.03, 0.16, 0.30), 0.15),
)
CLOTHES: tuple[tuple[Paint, float], ...] = (
    ((0.03, 0.04, 0.07), 0.25),
    ((0.35, 0.05, 0.04), 0.15),
    ((0.55, 0.54, 0.50), 0.2),
    ((0.06, 0.12, 0.25), 0.2),
    ((0.45, 0.33, 0.06), 0.1),
    ((0.10, 0.18, 0.08), 0.1),
)


def fastest_mps(kind: str) -> float:
    """Faster than this nobody of a kind moves in a street: a check of measured tracks."""
    return {"pedestrian": 12.0, "bicycle": 25.0}.get(BODIES[kind].label, 70.0)


def paints(kind: str) -> tuple[tuple[Paint, float], ...]:
    """The paints, liveries or clothes of a kind, each with how often it is drawn."""
    label = BODIES[kind].label
    if label in ("bus", "truck"):
        return LIVERIES
    return CLOTHES if label in ("bicycle", "pedestrian") else PAINTS
