"""The keys of a scene file that say who drives and walks, and how."""

from dataclasses import dataclass
from typing import Literal

from synth.checking import key
from synth.traffic.fleet import DrivenKind

Interval = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Signal:
    """Traffic lights at the crossing; without this table everybody may drive when the road is clear. There is no
    amber: who would have to brake harder than 4 m/s² when the light turns red drives on."""

    east_west_green_s: tuple[Interval, ...] = key(
        "[start, end] of every interval in which traffic from the east and the west has green; red otherwise", unit="s"
    )
    north_south_green_s: tuple[Interval, ...] = key("the same for the north and the south", unit="s")


@dataclass(frozen=True, kw_only=True)
class Traffic:
    """Drivers follow the intelligent driver model (Treiber, Hennecke, Helbing, 2000)."""

    step_s: float = key("step of the simulation; poses between steps are exact for it", unit="s", range=(0.001, 1),
                        default=0.02)  # fmt: skip
    acceleration_mps2: float = key("greatest acceleration", unit="m/s²", range=(0.1, 10), default=2.0)
    deceleration_mps2: float = key("comfortable braking", unit="m/s²", range=(0.1, 10), default=3.0)
    headway_s: float = key("time gap to the vehicle ahead", unit="s", range=(0.1, 10), default=1.0)
    gap_m: float = key("distance to the vehicle ahead at standstill", unit="m", range=(0.1, 20), default=1.5)
    parked_share: float = key("share of the parking bays that are taken", range=(0, 1), default=0.5)
    warm_up_s: float = key("how long traffic has been flowing when the clip starts", unit="s", range=(0, 600),
                           default=60.0)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """One table for each vehicle that is placed by hand. Two vehicles that would ever overlap are refused."""

    route: str = key('"from-to" of two arms, e.g. "west-east"; on streets with several lanes "west-east/1" is the '
                     "second from the right")  # fmt: skip
    position_m: float = key("its front bumper at time 0 along the route: 0 at the stop line, negative before it",
                            unit="m", range=(-10_000, 10_000))  # fmt: skip
    speed_mps: float = key("speed at time 0", unit="m/s", range=(0, 60))
    cruise_mps: float = key("speed on a free road", unit="m/s", range=(0.5, 60), default=9.0)
    kind: DrivenKind = key("its body", default="saloon")
    colour: tuple[float, float, float] | None = key(
        "its paint, linear RGB; drawn from the seed if absent", range=(0, 1), default=None
    )


@dataclass(frozen=True, kw_only=True)
class Flow:
    """Traffic that comes by itself: vehicles enter at the far ends of the lanes at random times, from `warm_up_s`
    before the clip. Shares need not add up to one."""

    arm: Literal["all", "east", "north", "west", "south"] = key("where it comes from", default="all")
    per_hour: float = key("vehicles an hour on every lane", unit="1/h", range=(0, 3000))
    cruise_mps: float = key("mean speed on a free road; single drivers differ by a tenth", unit="m/s", range=(0.5, 60),
                            default=10.0)  # fmt: skip
    turning: float = key("share that turns off, left and right alike", range=(0, 1), default=0.25)
    vans: float = key("share of vans", range=(0, 1), default=0.08)
    buses: float = key("share of buses", range=(0, 1), default=0.02)
    trucks: float = key("share of trucks", range=(0, 1), default=0.04)
    cyclists_per_hour: float = key("cyclists an hour on every cycle lane", unit="1/h", range=(0, 3000), default=0.0)


@dataclass(frozen=True, kw_only=True)
class Parking:
    """Parked vehicles that leave during the clip, and vehicles that arrive and stop."""

    leaving: int = key("how many leave", range=(0, 50), default=0)
    arriving: int = key("how many arrive and park", range=(0, 50), default=0)
    reach_m: float = key("only bays nearer than this to the origin", unit="m", range=(5, 1000), default=60.0)


@dataclass(frozen=True, kw_only=True)
class Pedestrians:
    """People on foot: along the pavements, and over the zebra crossings when they may."""

    crossing: int = key("how many cross the street during the clip", range=(0, 500), default=0)
    strolling: int = key("how many walk along the pavements", range=(0, 500), default=0)
    speed_mps: float = key("mean walking speed", unit="m/s", range=(0.3, 4), default=1.35)
