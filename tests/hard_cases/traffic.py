"""Traffic and the intelligent driver model: gaps, speeds and steps at which car following breaks down."""

from __future__ import annotations

import math

import numpy as np

from aa4d.stress.cases import Part
from synth.errors import InputError
from synth.spec import parse_scene
from synth.traffic.following import ballistic, idm_acceleration, within_gap
from synth.traffic.settings import Traffic
from tests.hard_cases.errors import refusal

PART = Part("traffic")


@PART.case(
    why="a gap of zero divides; a slow wish at high speed overflows its fourth power",
    done="a smallest gap, a capped ratio, and brakes and engine as bounds",
    each={f"cruise {v:g} m/s": v for v in (1e-300, 0.5, 60.0, 1e300)},
)
def accelerations_stay_within_brakes_and_engine(cruise: float) -> float:
    grid = np.meshgrid([0.0, 1e-300, 5.0, 40.0, 1e100], [-3.0, 0.0, 1e-300, 2.0, np.inf], [-1e100, 0.0, 1e100])
    speed, gap, closing = (a.ravel() for a in grid)
    with np.errstate(over="ignore"):
        found = idm_acceleration(speed, np.full(speed.shape, cruise), gap, closing, Traffic())
    return max(-9.0 - found.min(), found.max() - 2.0, 0.0) if np.isfinite(found).all() else math.inf


def standing_leader(step_s: float, speed_mps: float, gap_m: float) -> float:
    """How far a follower gets into a vehicle that stands, metres."""
    position, speed = np.array([0.0]), np.array([speed_mps])
    traffic, still, worst = Traffic(step_s=step_s), np.zeros(1), 0.0
    for _ in range(int(20 / step_s)):
        gap = gap_m - position
        acceleration = idm_acceleration(speed, np.array([20.0]), gap, speed, traffic)
        acceleration = within_gap(acceleration, speed, gap, still, step_s)
        position, speed = ballistic(position, speed, acceleration, step_s)
        if not np.isfinite(position).all() or speed[0] < 0:
            return math.inf
        worst = max(worst, float(position[0] - gap_m))
    return worst if speed[0] < 0.5 else math.inf


@PART.case(
    why="at coarse steps a follower passes through the vehicle ahead",
    done="a step never ends inside the leader, who is taken to brake as hard as it can",
    bound=1e-6,
    each={
        f"step {s:g} s, {v:g} m/s, gap {g:g} m": (s, v, g)
        for s in (0.02, 1.0)
        for v in (0.0, 40.0)
        for g in (0.0, 0.5, 120.0)
    },
)
def a_standing_vehicle_ahead(given: tuple[float, float, float]) -> float:
    return standing_leader(*given)


@PART.case(why="speed / acceleration of a vehicle that neither moves nor brakes is 0 / 0", done="it stands")
def motion_of_what_stands() -> float:
    zero = np.zeros(3)
    position, speed = ballistic(zero, zero, np.array([0.0, -9.0, -1e-300]), 1.0)
    return float(max(np.abs(position).max(), np.abs(speed).max()))


@PART.case(why="who brakes would drive backwards at the end of a long step", done="stops within the step", bound=1e-12)
def braking_within_a_long_step() -> float:
    position, speed = ballistic(np.zeros(1), np.array([10.0]), np.array([-5.0]), 1e6)
    return max(abs(float(position[0]) - 10.0), abs(float(speed[0])))


SCENE: dict[str, object] = {
    "name": "x",
    "time": {"fps": 10, "frames": 3},
    "camera": {"width_px": 64, "height_px": 48, "fov_deg": 60},
    "flight": {"kind": "hover", "position_m": [0, 0, 30], "pitch_deg": -90},
    "street": {"kind": "straight"},
}


@PART.case(
    why="numbers that TOML can hold and no scene can have",
    done="refused with the file, the key and what is allowed",
    each={
        "frames = 10^400": ("frames", 10**400),
        "fps = nan": ("fps", math.nan),
        "fps = inf": ("fps", math.inf),
        "frames = true": ("frames", True),
        "fps = 1e-300": ("fps", 1e-300),
    },
)
def impossible_numbers_of_a_scene(change: tuple[str, object]) -> float:
    key, value = change
    table = SCENE | {"time": {"fps": 10, "frames": 3} | {key: value}}
    return refusal(InputError, lambda: parse_scene(table, "x.toml"), "x.toml", f"time.{key}")
