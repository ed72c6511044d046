"""Rigid groups and tracks: headings, trajectories and appearances at their limits."""

from __future__ import annotations

import math

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from aa4d.motion.fit import Priors, Sightings, fit_track, unwrapped
from aa4d.motion.groups import Groups, carry, pose_of
from aa4d.motion.spline import controls_for, design, weights_at
from aa4d.motion.tracks import ALWAYS, trapezoid
from aa4d.raster.types import Gaussians
from aa4d.stress.cases import Part

PART = Part("groups")


def some_groups(*shown: tuple[float, ...]) -> Groups:
    control = torch.zeros(len(shown), 6, 4)
    control[..., 0] = torch.linspace(-0.2, 0.2, 6)
    names = tuple(f"mover {g}" for g in range(len(shown)))
    return Groups(names, control, torch.zeros(len(shown), 4), torch.tensor(shown), torch.tensor([0.0, 0, 1]))


@PART.case(
    why="headings grow by whole turns: float32 of 1e4 radians has four digits behind the point",
    done="learning may leave its start by a bounded angle; against scipy in float64",
    bound=2e-3,
    each={f"{angle:g} rad": angle for angle in (0.0, 1e-30, math.pi, 100.0, 1e4)},
)
def heading_of(angle: float) -> float:
    up = np.array([0.2, -0.3, 1.0]) / np.linalg.norm([0.2, -0.3, 1.0])
    found = pose_of(torch.zeros(1, 3), torch.tensor([angle]), torch.tensor(up).float()).rotation[0].double().numpy()
    return float(np.abs(found - Rotation.from_rotvec(up * angle).as_matrix()).max())


@PART.case(
    why="a trajectory that learning threw out of the world",
    done="comes back to its bound",
    bound=1e-4,
    each={"1e30": 1e30, "infinity": math.inf},
)
def trajectory_thrown_to(value: float) -> float:
    groups = some_groups(ALWAYS)
    with torch.no_grad():
        groups.position[0, 2, 0] += value
        groups.position[0, 3, 1] += 1e-3
        groups.heading[0, 1] = -value
    groups.bound(0.02, 0.3)
    shift = (groups.position - groups.start[..., :3])[0].detach()
    if not (groups.position.isfinite().all() and groups.heading.isfinite().all()):
        return math.inf
    kept = abs(float(shift[3, 1]) - 1e-3) / 1e-3
    return max(kept, float(shift.norm(dim=1).max()) / 0.02 - 1, abs(float(groups.heading[0, 1].detach())) / 0.3 - 1)


@PART.case(
    why="a trajectory that is NaN, taken for its start, would train on without a word",
    done="stays NaN, in position and heading alike, where the watch finds it",
)
def trajectory_of_nan() -> float:
    groups = some_groups(ALWAYS)
    with torch.no_grad():
        groups.position[0, 2, 0] = groups.heading[0, 1] = math.nan
    groups.bound(0.02, 0.3)
    return 0.0 if groups.position[0, 2, 0].isnan() and groups.heading[0, 1].isnan() else math.inf


@PART.case(why="appearing at an instant: a ramp of no length is 0 / 0", done="ramps of a billionth at least")
def presence_at_an_instant() -> float:
    groups = some_groups((0.5, 0.5, 0.5, 0.5), (0.4, 0.4, 2, 3), ALWAYS)
    worst = 0.0
    for t in (-math.inf, 0.0, 0.3, 0.5, 1.0, math.inf):
        found = groups.presence(t)
        assert found.isfinite().all()
        worst = max(worst, float((-found).clamp_min(0).max()), float((found - 1).clamp_min(0).max()))
    return max(worst, abs(float(groups.presence(0.3)[1])), abs(float(groups.presence(0.41)[1]) - 1))


@PART.case(
    why="times outside the clip, or of a clip of one frame",
    done="clamped to the first and the last segment",
    bound=1e-12,
    each={str(t): t for t in (-3.0, 0.0, 1.0, 17.0, 1e300)},
)
def spline_at(t: float) -> float:
    first, weights = weights_at(t, 9)
    assert 0 <= first <= 9 - 4
    assert (weights >= 0).all()
    return abs(float(weights.sum()) - 1)


@PART.case(
    why="clips of one frame, of a thousand a second, of hours", done="at least one segment, at most one in 3 frames"
)
def numbers_of_control_points() -> float:
    found = [controls_for(1, 30.0, 0.5), controls_for(2, 1000.0, 0.5), controls_for(100_000, 0.1, 0.5)]
    return 0.0 if found[0] == found[1] == 4 and 4 <= found[2] <= 100_000 / 3 + 3 else math.inf


@PART.case(why="nothing rides", done="the Gaussians themselves")
def carry_of_nobody() -> float:
    ones = Gaussians(torch.rand(6, 3), torch.rand(6, 4), torch.rand(6, 3), torch.rand(6), torch.rand(6, 3))
    nobody = torch.zeros(0, dtype=torch.long)
    after = carry(ones, 3, nobody, some_groups(ALWAYS).pose(0.5).at(nobody), torch.zeros(0))
    return float((after.means - ones.means).abs().max().detach())


def sightings(t: list[float], x: list[float], **changes: object) -> Sightings:
    n = len(t)
    position = np.stack([np.array(x), np.zeros(n), np.zeros(n)], 1)
    values: dict[str, object] = {
        "t": np.array(t),
        "position": position,
        "position_sd": np.full(n, 0.1),
        "velocity": np.full((n, 3), np.nan),
        "velocity_sd": np.full(n, 0.1),
        "heading": np.full(n, np.nan),
    } | changes
    return Sightings(**values)  # type: ignore[arg-type]


PRIORS = Priors(acceleration_sd=0.01, least_speed=0.01)
UP = np.array([0.0, 0, 1])


@PART.case(why="one sighting without velocity leaves the whole way open", done="it stands there", bound=1e-3)
def track_of_one_sighting() -> float:
    control = fit_track(sightings([0.5], [3.0]), 8, 50, UP, PRIORS)
    return float(np.abs(design(np.linspace(0, 1, 20), 8) @ control[:, :3] - [3, 0, 0]).max())


@PART.case(why="a sighting a kilometre off", done="reweighted: it counts as far as a good one may be off", bound=0.5)
def track_with_an_outlier() -> float:
    t = np.linspace(0, 1, 30)
    x = 10 * t
    x[11] = 1000.0
    control = fit_track(sightings(t.tolist(), x.tolist()), 12, 30, UP, PRIORS)
    return float(np.abs((design(t, 12) @ control[:, :3])[:, 0] - 10 * t).max())


@PART.case(why="world coordinates of 1e7 beside steps of centimetres", done="fitted about the mean", bound=0.02)
def track_far_from_the_origin() -> float:
    t = np.linspace(0, 1, 30)
    control = fit_track(sightings(t.tolist(), (1e7 + 10 * t).tolist()), 12, 30, UP, PRIORS)
    return float(np.abs((design(t, 12) @ control[:, :3])[:, 0] - 1e7 - 10 * t).max())


@PART.case(why="a vehicle that stands has no direction of motion", done="one heading, held; finite")
def heading_of_a_standing_track() -> float:
    t = np.linspace(0, 1, 30)
    control = fit_track(sightings(t.tolist(), [2.0] * 30), 12, 30, UP, PRIORS)
    return float(np.ptp(control[:, 3])) if np.isfinite(control).all() else math.inf


@PART.case(
    why="headings that wrap, and a vehicle that backs up by half a turn",
    done="whole and half turns taken out",
    bound=1e-9,
)
def headings_that_wrap() -> float:
    way = np.linspace(0, 20, 200)
    wrapped = (way + math.pi) % (2 * math.pi) - math.pi
    backing = np.where(np.arange(200) > 120, wrapped + math.pi, wrapped)
    return max(float(np.abs(unwrapped(angles) - way).max()) for angles in (wrapped, backing))


@PART.case(why="a share of presence with ramps of no length", done="steps", each={"at once": (0.3, 0.3, 0.6, 0.6)})
def trapezoid_without_ramps(shown: tuple[float, ...]) -> float:
    found = trapezoid(np.array(shown), np.array([0.0, 0.299, 0.301, 0.5, 0.599, 0.601, 1.0]))
    return float(np.abs(found - [0, 0, 1, 1, 1, 0, 0]).max())


@PART.case(
    why="gradients of a ride at a heading of zero",
    done="smooth there: sine and 1 - cosine of the angle itself",
    bound=1e-6,
)
def gradient_of_a_ride() -> float:
    def ride(heading: Tensor) -> Tensor:
        return pose_of(torch.zeros(1, 3).double(), heading, torch.tensor([0.0, 0, 1]).double()).rotation.sum()

    heading = torch.zeros(1, dtype=torch.float64, requires_grad=True)
    (found,) = torch.autograd.grad(ride(heading), heading)
    step = 1e-6
    truth = (ride(heading + step) - ride(heading - step)) / (2 * step)
    return abs(float((found - truth).detach()))
