"""Kinds of vehicles and their sizes."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Body:
    """Outer dimensions in metres."""

    length_m: float
    width_m: float
    height_m: float
    wheelbase_m: float

    @property
    def dimensions_m(self) -> tuple[float, float, float]:
        return self.length_m, self.width_m, self.height_m


BODIES = {
    "hatchback": Body(4.05, 1.78, 1.48, 2.55),
    "saloon": Body(4.65, 1.84, 1.45, 2.80),
    "suv": Body(4.70, 1.92, 1.70, 2.75),
    "van": Body(5.30, 2.00, 2.25, 3.20),
}

# Linear RGB of common paints, and how often each is drawn.
PAINTS = (
    ((0.80, 0.80, 0.78), 0.20),  # white
    ((0.42, 0.44, 0.46), 0.15),  # silver
    ((0.015, 0.016, 0.018), 0.15),  # black
    ((0.10, 0.11, 0.12), 0.12),  # grey
    ((0.45, 0.02, 0.02), 0.14),  # red
    ((0.02, 0.07, 0.32), 0.12),  # blue
    ((0.03, 0.14, 0.08), 0.05),  # green
    ((0.65, 0.38, 0.03), 0.07),  # yellow
)
