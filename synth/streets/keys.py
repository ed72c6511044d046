"""Keys that several streets share; a street takes those that it reads."""

from dataclasses import dataclass

from synth.checking import key


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """What every street has."""

    arm_m: float = key("how far lanes, markings and parked cars reach from the center", unit="m", range=(30, 1000),
                       default=150.0)  # fmt: skip
    lane_width_m: float = key("width of one lane", unit="m", range=(2.5, 5), default=3.2)
    pavement_width_m: float = key("width of the pavement behind the curb", unit="m", range=(1.5, 10), default=3.2)


@dataclass(frozen=True, kw_only=True)
class ParkingStrip:
    """Parking along the curbs."""

    parking_width_m: float = key("width of the parking strip between lane and curb; 0: none", unit="m", range=(0, 4),
                                 default=2.1)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class CycleLanes:
    """Lanes for cyclists."""

    cycle_width_m: float = key("width of the cycle lane beside the outermost lane; 0: none", unit="m", range=(0, 3),
                               default=0.0)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Corners:
    """Rounded curbs where streets meet."""

    corner_radius_m: float = key("radius of the curb at the corners", unit="m", range=(2, 15), default=3.5)
