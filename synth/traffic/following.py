"""The intelligent driver model (IDM) of car following, and what keeps it sound at coarse steps.

Treiber, Hennecke, Helbing, "Congested traffic states in empirical observations and microscopic simulations",
Physical Review E 62 (2000), equations 2 and 3.
"""

import numpy as np
from numpy.typing import NDArray

from synth.traffic.settings import Traffic

Array = NDArray[np.float64]

HARDEST_BRAKING_MPS2 = 9.0  # dry asphalt: below this the model's interaction term is not physical
SMALLEST_GAP_M = 0.01  # the interaction term divides by the gap
AT_ONCE_MPS2 = 1e9  # stops within any step


def idm_acceleration(speed: Array, cruise: Array, gap: Array, closing: Array, traffic: Traffic) -> Array:
    """Acceleration [M] in m/s^2 of drivers at `speed` who want `cruise`, `gap` behind a leader, at speed difference
    `closing` (own minus leader's). A gap of +inf is a free road; gaps of zero or less brake as hard as possible."""
    a, b = traffic.acceleration_mps2, traffic.deceleration_mps2
    desired = traffic.gap_m + np.maximum(0.0, speed * traffic.headway_s + speed * closing / (2 * np.sqrt(a * b)))
    interaction = desired / np.maximum(gap, SMALLEST_GAP_M)
    # Capped before it is raised to a power: a slow wish at high speed would overflow.
    acceleration = a * (1 - np.minimum(speed / cruise, 1e3) ** 4 - interaction**2)
    return np.clip(acceleration, -HARDEST_BRAKING_MPS2, a)


def within_gap(acceleration: Array, speed: Array, gap: Array, leader_speed: Array, step_s: float) -> Array:
    """The acceleration [M], lowered where a step of `step_s` seconds would end inside the leader.

    IDM is continuous in time: at fine steps this changes nothing. The leader is taken to brake as hard as it can; a
    driver who is closer than brakes could help stops short of it, as an obstacle would make him.
    """
    until_stop = np.minimum(step_s, leader_speed / HARDEST_BRAKING_MPS2)
    room = gap + until_stop * (leader_speed - 0.5 * HARDEST_BRAKING_MPS2 * until_stop)
    reached, _ = ballistic(np.zeros_like(speed), speed, acceleration, step_s)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        needed = np.where(room > 0, -np.minimum(speed**2 / (2 * room), AT_ONCE_MPS2), -AT_ONCE_MPS2)
    return np.where((reached > room) & (speed > 0), np.minimum(acceleration, needed), acceleration)


def ballistic(position: Array, speed: Array, acceleration: Array, elapsed: Array | float) -> tuple[Array, Array]:
    """Position and speed after `elapsed` seconds of constant acceleration; who would reverse stands still instead.

    Treiber, Kanagaraj, "Comparing numerical integration schemes for time-continuous car-following models" (2015).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        until_stop = np.where(acceleration < 0, -speed / acceleration, np.inf)
    tau = np.minimum(elapsed, until_stop)
    stopped = until_stop <= elapsed
    new_speed = np.where(stopped, 0.0, np.maximum(0.0, speed + acceleration * tau))
    return position + speed * tau + 0.5 * acceleration * tau**2, new_speed
