"""Bodies of followed points, judged and joined over time: which of them are movers, and which are one and the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from aa4d.motion.points import MOVING_PX, Points

REMNANT = 0.15  # of a body's usual number of points: fewer are no sighting
SHOWN = 0.1  # of its points in a frame, on what the static scene does not show
STRAY_PX = 3.0  # of a point from its body
FEWEST_POINTS = 4  # at once, of a body that is judged at all
WAY_PX = 4.0  # the least that a mover travels over the ground
HIDDEN_PX = 8.0  # and more, by the share of its points that the static scene shows: it must leave that place
MISFIT_PX = 1.8  # the least by which its points miss what stands still
DIFFERING = 0.25  # of its points, over all frames: on what the static scene does not show
STRAIGHT = 0.5  # of its path that gets it anywhere: what sways does not
BRIEF_FRAMES = 4  # seen for fewer frames than this, a mover must show more
BRIEF_POINTS = 10
BRIEF_STEP_PX = 1.2  # a frame
BRIEF_MISFIT = 0.6  # of the usual one: over few frames a mover misses what stands by less
LONGEST_GAP = 8  # clip frames over which a body is looked for again, unless it stands
STANDING_PX = 0.25  # a frame
OFF_PX = (5.0, 1.0)  # that a prediction may miss by: at once, and more for each frame
SPEEDS_PX = 1.2  # a frame, of velocities before and after a gap
BESIDE_PX = 6.0  # in the picture: a smaller body there is the rim of the larger, where flow slips
BESIDE = 0.5  # of the way of the smaller one
LARGER, AMONG = 3.0, 0.5  # times as many points, of what has rims, and of what another may lie among
TOUCHING_PX = 4.0  # between two parts of one mover, in the picture
BORDER = 0.2  # of the points of the smaller one lie at their common border: a stray one is no bridge
PARTING_PX = 3.5  # between those, over all their common frames
PARTING = 0.04  # and more, of the way: flow slips, and bodies turn

QUARTER_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])  # of row vectors, to the left

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Body:
    """Points that move as one, and their mean motion; lengths in pixels of the median depth, over the ground."""

    members: Ints  # of the points
    number: Ints  # [V] points alive
    place: Array  # [V, 2] mean of the points; NaN where there is none
    velocity: Array  # [V - 1, 2] a clip frame, between successive training frames; NaN where unknown
    misfit: float  # of its points, median
    differing: float  # share of its points on what the static scene does not show
    on: Mask  # [M, V] when each of the members is on it

    def pixels(self, points: Points, v: int) -> NDArray[np.float32]:
        """[N, 2]: its points in frame v."""
        return points.pixels[self.members[self.on[:, v]], v]

    @property
    def first(self) -> int:
        return int(np.flatnonzero(self.number)[0])

    @property
    def last(self) -> int:
        return int(np.flatnonzero(self.number)[-1])


def body_of(points: Points, members: Ints, gaps: Ints, on: Mask | None = None) -> Body:
    """The mean motion of some points, over all frames or while they are `on` [M, V]."""
    alive = points.alive[members] if on is None else on
    places = np.where(alive[..., None], points.places[members].astype(np.float64), np.nan)
    number = alive.sum(0)
    with np.errstate(invalid="ignore"):
        place = np.where(alive[..., None], places, 0).sum(0) / np.where(number > 0, number, np.nan)[:, None]
    steps = np.diff(places, axis=1) / gaps[None, :, None]
    velocity = np.full((len(gaps), 2), np.nan)
    for s in range(len(gaps)):
        known = np.isfinite(steps[:, s, 0])
        if known.any():
            velocity[s] = np.median(steps[known, s], axis=0)
    differing = float((points.differs[members] & alive).sum() / max(alive.sum(), 1))
    return Body(members, number, place, velocity, float(np.median(points.misfit[members])), differing, alive)


def joined_of(bodies: list[Body], points: Points, gaps: Ints) -> Body:
    """Several bodies as one."""
    members, on = np.concatenate([b.members for b in bodies]), np.concatenate([b.on for b in bodies])
    return body_of(points, members, gaps, on)


def trimmed(body: Body, points: Points, gaps: Ints) -> Body:
    """Without the frames at either end in which hardly a point is left, or it stands and the static scene shows it all.

    What is there lies on something else.
    """
    usual = float(np.percentile(body.number[body.number > 0], 75))
    differs = (points.differs[body.members] & body.on).sum(0) >= SHOWN * np.maximum(body.number, 1)
    speed = np.linalg.norm(np.nan_to_num(body.velocity), axis=1)
    moves = np.concatenate([speed[:1], np.maximum(speed[:-1], speed[1:]), speed[-1:]]) > MOVING_PX
    enough = np.flatnonzero((body.number >= max(2.0, REMNANT * usual)) & (differs | moves))
    if not len(enough):
        return body
    on = body.on.copy()
    on[:, : enough[0]] = on[:, enough[-1] + 1 :] = False
    return body_of(points, body.members, gaps, on)


def pruned(body: Body, points: Points, gaps: Ints) -> Body:
    """Without points while they stray from the others: on the road beside it, or on what hides it."""
    steps = np.diff(points.places[body.members].astype(np.float64), axis=1) - body.velocity * gaps[:, None]
    stray = np.cumsum(np.nan_to_num(steps), axis=1)
    stray = np.concatenate([np.zeros((len(stray), 1, 2)), stray], axis=1)
    followed = body.on.any(1)
    usual = np.zeros((len(stray), 1, 2))
    usual[followed] = np.nanmedian(np.where(body.on[..., None], stray, np.nan)[followed], axis=1, keepdims=True)
    allowed = STRAY_PX + PARTING * way(body, gaps)[0]
    on = body.on & (np.linalg.norm(stray - usual, axis=2) <= allowed)
    return trimmed(body_of(points, body.members, gaps, on), points, gaps) if on.any() else body


def way(body: Body, gaps: Ints) -> tuple[float, float]:
    """How far a body gets between any two of its frames, and the length of its path; pixels over the ground."""
    steps = np.nan_to_num(body.velocity) * gaps[:, None]
    path = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    apart = np.linalg.norm(path[:, None] - path[None], axis=2)
    # Jitter of a body that stands is no path: steps are summed over three frames.
    smooth = np.stack([np.convolve(steps[:, c], np.ones(3) / 3, mode="same") for c in (0, 1)], 1)
    return float(apart.max()), float(np.linalg.norm(smooth, axis=1).sum())


def is_mover(body: Body, points: Points, gaps: Ints) -> bool:
    """Whether a body gets somewhere, as a whole, against the static scene."""
    if body.number.max() < FEWEST_POINTS:
        return False
    net, path = way(body, gaps)
    frames, misfit = int((body.number > 0).sum()), MISFIT_PX
    if frames < BRIEF_FRAMES:
        misfit *= BRIEF_MISFIT
        speeds = np.linalg.norm(body.velocity[np.isfinite(body.velocity[:, 0])], axis=1)
        if not len(speeds) or speeds.min() < BRIEF_STEP_PX or body.number.max() < BRIEF_POINTS:
            return False
        net += WAY_PX - BRIEF_STEP_PX * len(speeds)  # it has had no time for more
    if _differing_under_way(body, points) < DIFFERING:
        return False
    return (
        net >= WAY_PX + HIDDEN_PX * (1 - body.differing)
        and body.misfit >= misfit
        and body.differing >= DIFFERING
        and net >= STRAIGHT * path
    )


def _differing_under_way(body: Body, points: Points) -> float:
    """The share of its points that are on what the static scene does not show, while it moves."""
    moving = np.flatnonzero(np.linalg.norm(np.nan_to_num(body.velocity), axis=1) > STANDING_PX)
    number = body.on[:, moving].sum()
    return float((points.differs[body.members][:, moving] & body.on[:, moving]).sum() / max(number, 1))


def linked(bodies: list[Body], points: Points, ranks: Ints) -> list[Body]:
    """Bodies that continue one another after a gap, joined; the best pairs over all at once, again and again."""
    gaps = np.diff(ranks)
    while len(bodies) > 1:
        cost = np.full((len(bodies), len(bodies)), np.inf)
        for i, a in enumerate(bodies):
            for j, b in enumerate(bodies):
                if i != j and a.last < b.first:
                    cost[i, j] = _mismatch(a, b, ranks)
        possible = np.isfinite(cost)
        if not possible.any():
            break
        rows, columns = linear_sum_assignment(np.where(possible, cost, 1e3))
        successor = {int(i): int(j) for i, j in zip(rows, columns, strict=True) if possible[i, j]}
        heads = set(range(len(bodies))) - set(successor.values())
        joined = []
        for head in sorted(heads):
            chain = [head]
            while chain[-1] in successor:
                chain.append(successor[chain[-1]])
            if len(chain) == 1:
                joined.append(bodies[head])
            else:
                joined.append(joined_of([bodies[i] for i in chain], points, gaps))
        bodies = joined
    return bodies


def _mismatch(a: Body, b: Body, ranks: Ints) -> float:
    """How badly b continues a, 0 at best; inf where it cannot."""
    gap = int(ranks[b.first] - ranks[a.last])
    va, vb = _end_velocity(a, -1), _end_velocity(b, +1)
    standing = max(np.linalg.norm(va), np.linalg.norm(vb)) < STANDING_PX
    if gap > LONGEST_GAP and not standing:
        return np.inf
    start, end = a.place[a.last], b.place[b.first]
    if standing:
        off, allowed = float(np.linalg.norm(end - start)), OFF_PX[0]
    else:
        ahead, back = np.linalg.norm(start + va * gap - end), np.linalg.norm(end - vb * gap - start)
        off, allowed = float(ahead + back) / 2, OFF_PX[0] + OFF_PX[1] * gap
    change = float(np.linalg.norm(va - vb))
    allowed_change = SPEEDS_PX + 0.15 * float(np.linalg.norm(va) + np.linalg.norm(vb))
    if off > allowed or change > allowed_change:
        return np.inf
    return off / allowed + change / allowed_change + 0.05 * gap


def _end_velocity(body: Body, side: int) -> Array:
    known = body.velocity[np.isfinite(body.velocity[:, 0])]
    if not len(known):
        return np.zeros(2)
    return np.median(known[-4:] if side < 0 else known[:4], axis=0)


def merged(bodies: list[Body], points: Points, gaps: Ints) -> list[Body]:
    """Bodies that keep together over all their common frames, joined: parts of one vehicle, or it and its shadow."""
    waiting = sorted(bodies, key=lambda b: b.number.sum())
    done: list[Body] = []
    while waiting:
        body = waiting.pop()  # the largest first: it tells best whether another belongs to it
        for k, other in enumerate(done):
            if _keep_together(other, body, points, gaps):
                done.pop(k)
                waiting.append(joined_of([other, body], points, gaps))
                break
        else:
            done.append(body)
    return done


def _turning(body: Body, gaps: Ints) -> Array:
    """[V - 1] radians by which its direction of motion turns over each step; 0 while it hardly moves."""
    velocity = np.nan_to_num(body.velocity)
    smooth = np.stack([np.convolve(velocity[:, c], np.ones(3) / 3, mode="same") for c in (0, 1)], 1)
    angle, moves = np.arctan2(smooth[:, 1], smooth[:, 0]), np.linalg.norm(smooth, axis=1) > 2 * STANDING_PX
    rate = np.zeros(len(velocity))
    both = moves[2:] & moves[:-2]
    change = (angle[2:] - angle[:-2] + np.pi) % (2 * np.pi) - np.pi
    rate[1:-1] = np.where(both, change / (gaps[2:] / 2 + gaps[1:-1] + gaps[:-2] / 2) * gaps[1:-1], 0)
    return rate


def _keep_together(a: Body, b: Body, points: Points, gaps: Ints) -> bool:
    common = np.flatnonzero((a.number > 0) & (b.number > 0))
    if len(common) < 2 or len(common) < 0.5 * min((a.number > 0).sum(), (b.number > 0).sum()):
        return False
    if np.nanmin(np.linalg.norm(a.place[common] - b.place[common], axis=1)) > 60:
        return False
    both = np.isfinite(a.velocity[:, 0]) & np.isfinite(b.velocity[:, 0])
    allowed = PARTING_PX + PARTING * way(b, gaps)[0]
    steps = (a.velocity - b.velocity) * gaps[:, None]
    turned = steps - _turning(b, gaps)[:, None] * (a.place - b.place)[:-1] @ QUARTER_TURN
    parting = (np.linalg.norm(np.ptp(np.cumsum(s[both], axis=0), axis=0)) for s in (steps, np.nan_to_num(turned)))
    if both.any() and float(min(parting)) > allowed:
        return False
    distances = []
    for v in common[:: max(len(common) // 6, 1)]:
        pa, pb = a.pixels(points, v), b.pixels(points, v)
        if len(pa) and len(pb):
            small, large = sorted((pa, pb), key=len)
            distances.append(float(np.percentile(cKDTree(large).query(small)[0], 100 * BORDER)))
    return bool(distances) and float(np.median(distances)) < TOUCHING_PX


def without_rims(bodies: list[Body], points: Points) -> list[Body]:
    """Bodies less those whose way lies beside a larger one: where flow slips between a mover and what is behind it."""
    kept: list[Body] = []
    for body in sorted(bodies, key=lambda b: -int(b.number.sum())):
        speed = np.linalg.norm(np.nan_to_num(body.velocity), axis=1)
        moving = np.flatnonzero(speed > STANDING_PX)
        moving = moving[:: max(len(moving) // 12, 1)]
        beside = sum(speed[v] for v in moving if any(_is_rim(body, other, points, v) for other in kept))
        if len(moving) and beside < BESIDE * speed[moving].sum():
            kept.append(body)
    return kept


def _is_rim(body: Body, other: Body, points: Points, v: int) -> bool:
    """Whether a body lies beside a far larger one in frame v, or among the points of one that is hardly smaller."""
    mine, theirs = body.pixels(points, v), other.pixels(points, v)
    if not len(mine) or len(theirs) < AMONG * len(mine):
        return False
    near = cKDTree(theirs).query(mine, distance_upper_bound=BESIDE_PX)[0] < BESIDE_PX
    return bool(near.mean() > (0.5 if len(theirs) >= LARGER * len(mine) else 0.85))
