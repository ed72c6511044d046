"""Points followed by flow: where something differs from the static scene or moves against it, while flow holds.

Short flows are trusted, long chains only while every step returns to its start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aa4d.motion.flow import CONSISTENT_PX, Flow, sample, static_flow
from aa4d.motion.ground import Ground
from aa4d.motion.observations import Observations
from aa4d.motion.standing import misfit

SPACING_PX = 2
MOVING_PX = 0.7  # a frame, against the static scene: that a pixel moves
JUMP_PX = 2.0  # a frame, by which a point's velocity changes, over two steps each way, where flow slips off a mover
STILL = 0.15  # of the mover's speed: what it slips onto is slower
REST = 1  # frames on the static scene that say nothing
STEPS_WITHOUT_REASON = 2  # a point that neither differs nor ever moved is given up

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Points:
    """N points over V frames; NaN where a point is not followed."""

    pixels: Floats  # [N, V, 2] centres at + 0.5
    places: Floats  # [N, V, 2] on the ground, in pixels of the median depth, along the ground's axes
    differs: Mask  # [N, V] it is where the frame differs from the static scene
    misfit: Array  # [N] pixels by which it misses the best point that stands still (aa4d/motion/standing.py)

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def alive(self) -> Mask:
        return np.isfinite(self.pixels[..., 0])

    def of(self, which: NDArray[np.generic]) -> Points:
        return Points(self.pixels[which], self.places[which], self.differs[which], self.misfit[which])


def moving_pixels(observed: Observations, flow: Flow, ground: Ground, allowed: Mask) -> Mask:
    """[V, H, W]: pixels whose flow fits neither the static surface nor the ground, towards both neighbouring frames."""
    views, height, width = observed.images.shape[:3]
    rows, columns = np.mgrid[:height, :width]
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5
    result = np.zeros((views, height, width), bool)
    for v in range(views):
        here = np.flatnonzero(allowed[v].ravel())
        least = np.full(len(here), np.inf)
        for other in (v - 1, v + 1):
            if not 0 <= other < views:
                continue
            p = min(v, other)
            measured = (flow.forward if other > v else flow.backward)[p].reshape(-1, 2)[here]
            error = (flow.forward_error if other > v else flow.backward_error)[p].reshape(-1)[here]
            gap = abs(int(observed.rank[other] - observed.rank[v]))
            away = np.minimum.reduce(
                [
                    np.nan_to_num(np.linalg.norm(measured - still, axis=1), nan=np.inf)
                    for still in standing(observed, ground, v, other, pixels[here])
                ]
            )
            least = np.minimum(least, np.where(error < CONSISTENT_PX, away / gap, 0))
        result[v].ravel()[here] = np.isfinite(least) & (least > MOVING_PX)
    return result


def standing(observed: Observations, ground: Ground, a: int, b: int, pixels: Array) -> list[Array]:
    """The flow of pixels [N, 2] from frame a to b, if they show the static surface, and if they show the ground."""
    column, row = np.floor(pixels).astype(int).T
    height, width = observed.static_depth_m.shape[1:]
    depth = observed.static_depth_m[a][np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)].astype(np.float64)
    surface = static_flow(observed, a, b, pixels, np.where(depth > 0, depth, np.nan))
    land = ground.lift(pixels, observed.viewmat[a], observed.K)
    depth = land @ observed.viewmat[a, 2, :3] + observed.viewmat[a, 2, 3]
    return [surface, static_flow(observed, a, b, pixels, depth)]


def follow(observed: Observations, flow: Flow, ground: Ground, reason: Mask, differs: Mask) -> Points:
    """Points that start where `reason` [V, H, W] holds and no other point is, followed both ways in time."""
    views, height, width = observed.images.shape[:3]
    births: list[NDArray[np.int64]] = []
    active = np.zeros((0,), int)
    pixels = np.full((0, views, 2), np.nan, np.float32)
    idle = np.zeros(0, int)
    moved = np.zeros(0, bool)
    for v in range(views):
        if v:
            start = pixels[active, v - 1].astype(np.float64)
            step = sample(flow.forward[v - 1], start)
            error = sample(flow.forward_error[v - 1], start)
            end = start + step
            gap = int(observed.rank[v] - observed.rank[v - 1])
            away = np.minimum.reduce(
                [
                    np.nan_to_num(np.linalg.norm(step - still, axis=1), nan=np.inf)
                    for still in standing(observed, ground, v - 1, v, start)
                ]
            )
            inside = (end > 0).all(1) & (end[:, 0] < width) & (end[:, 1] < height)
            good = inside & (error < CONSISTENT_PX)
            moved[active] |= good & (away > MOVING_PX * gap) & np.isfinite(away)
            column, row = np.floor(np.where(inside[:, None], end, 0)).astype(int).T
            why = reason[v][row, column]
            idle[active] = np.where(why | moved[active], 0, idle[active] + 1)
            good &= idle[active] <= STEPS_WITHOUT_REASON
            pixels[active[good], v] = end[good]
            active = active[good]
        taken = np.zeros((-(-height // SPACING_PX), -(-width // SPACING_PX)), bool)
        if len(active):
            column, row = (pixels[active, v] // SPACING_PX).astype(int).T
            taken[np.minimum(row, taken.shape[0] - 1), np.minimum(column, taken.shape[1] - 1)] = True
        rows, columns = np.nonzero(reason[v][::SPACING_PX, ::SPACING_PX] & ~taken)
        fresh = np.full((len(rows), views, 2), np.nan, np.float32)
        fresh[:, v, 0], fresh[:, v, 1] = columns * SPACING_PX + 0.5, rows * SPACING_PX + 0.5
        active = np.concatenate([active, np.arange(len(pixels), len(pixels) + len(rows))])
        pixels = np.concatenate([pixels, fresh])
        idle = np.concatenate([idle, np.zeros(len(rows), int)])
        moved = np.concatenate([moved, np.zeros(len(rows), bool)])
        births.append(np.full(len(rows), v))
    born = np.concatenate(births) if births else np.zeros(0, int)
    keep = np.flatnonzero(moved & (np.isfinite(pixels[..., 0]).sum(1) > 1))
    pixels, born = pixels[keep], born[keep]
    _backwards(pixels, born, flow, height, width)
    _let_go(pixels, differs)
    return _placed(observed, ground, pixels, differs)


def _backwards(pixels: Floats, born: NDArray[np.int64], flow: Flow, height: int, width: int) -> None:
    """Follow points to the frames before the one they began in, as far as flow holds; in place."""
    active = np.zeros(0, int)
    for v in range(pixels.shape[1] - 1, 0, -1):
        active = np.concatenate([active, np.flatnonzero(born == v)])
        start = pixels[active, v].astype(np.float64)
        end = start + sample(flow.backward[v - 1], start)
        error = sample(flow.backward_error[v - 1], start)
        good = (error < CONSISTENT_PX) & (end > 0).all(1) & (end[:, 0] < width) & (end[:, 1] < height)
        pixels[active[good], v - 1] = end[good]
        active = active[good]


def _let_go(pixels: Floats, differs: Mask) -> None:
    """End points that lie on the static scene both before and after something passed: it dragged them; in place.

    On one side only, a point may be on a vehicle that is parked there.
    """
    alive = np.isfinite(pixels[..., 0])
    column, row = np.floor(np.where(alive[..., None], pixels, 0)).astype(int).transpose(2, 0, 1)
    on = differs[np.arange(pixels.shape[1])[None], row, column] & alive
    frames = np.arange(pixels.shape[1])[None]
    begin, end = alive.argmax(1), pixels.shape[1] - 1 - alive[:, ::-1].argmax(1)
    first, last = on.argmax(1), pixels.shape[1] - 1 - on[:, ::-1].argmax(1)
    dragged = on.any(1) & (first > begin + REST) & (last < end - REST)
    pixels[dragged[:, None] & ((frames < first[:, None]) | (frames > last[:, None]))] = np.nan


def _placed(observed: Observations, ground: Ground, pixels: Floats, differs: Mask) -> Points:
    places = np.full(pixels.shape, np.nan, np.float32)
    on = np.zeros(pixels.shape[:2], bool)
    for v in range(pixels.shape[1]):
        here = np.flatnonzero(np.isfinite(pixels[:, v, 0]))
        at = pixels[here, v].astype(np.float64)
        points = ground.lift(at, observed.viewmat[v], observed.K)
        places[here, v] = (points - ground.origin) @ ground.axes.T / observed.pixel
        column, row = np.floor(at).astype(int).T
        on[here, v] = differs[v][row, column]
    slipped = ~longest_run(np.isfinite(places[..., 0]) & ~slips(places, np.diff(observed.rank)))
    pixels[slipped] = places[slipped] = np.nan
    on &= ~slipped
    return Points(pixels, places, on, misfit(observed, ground, pixels))


def slips(places: Floats, gaps: NDArray[np.int64]) -> Mask:
    """[N, V]: when points [N, V, 2] are not on what moved: their velocity jumps as no vehicle's does.

    The slower side of a jump is the road that a mover passed, or what hides it.
    """
    before, after = _mean_velocities(places, gaps, -1), _mean_velocities(places, gaps, +1)
    speed_before, speed_after = np.linalg.norm(before, axis=2), np.linalg.norm(after, axis=2)
    slower, faster = np.minimum(speed_before, speed_after), np.maximum(speed_before, speed_after)
    jump = (np.nan_to_num(np.linalg.norm(after - before, axis=2)) > JUMP_PX) & (slower < STILL * faster)
    slower_after = jump & (speed_after < speed_before)
    slower_before = jump & ~slower_after
    result = np.zeros(places.shape[:2], bool)
    for v in range(1, places.shape[1] - 1):
        # A jump at frame v ends what came before it, or begins what goes on.
        result[:, v + 1] = (result[:, v] & ~slower_before[:, v - 1]) | slower_after[:, v - 1]
    back = np.zeros_like(result)
    for v in range(places.shape[1] - 2, 0, -1):
        back[:, v - 1] = (back[:, v] & ~slower_after[:, v - 1]) | slower_before[:, v - 1]
    return result | back


def _mean_velocities(places: Floats, gaps: NDArray[np.int64], side: int) -> Floats:
    """[N, V - 2, 2]: a clip frame, over up to two steps before (-1) or after (1) every frame but the first and last."""
    steps = np.diff(places, axis=1)
    near, far = (steps[:, :-1], steps[:, :-2]) if side < 0 else (steps[:, 1:], steps[:, 2:])
    time, more = (gaps[:-1], gaps[:-2]) if side < 0 else (gaps[1:], gaps[2:])
    missing = np.full((len(places), 1, 2), np.nan, np.float32)
    far = np.concatenate([missing, far] if side < 0 else [far, missing], axis=1)
    more = np.concatenate([[0], more] if side < 0 else [more, [0]])
    two = np.isfinite(far[..., :1])
    return np.asarray(
        np.where(two, near + far, near) / np.where(two, (time + more)[:, None], time[:, None]), np.float32
    )


def longest_run(alive: Mask) -> Mask:
    """[N, V]: the longest stretch of frames of each row: what a point shows after a gap may be another mover."""
    length = np.zeros(alive.shape, int)
    for v in range(alive.shape[1]):
        length[:, v] = np.where(alive[:, v], (length[:, v - 1] if v else 0) + 1, 0)
    end = length.argmax(axis=1)
    frames = np.arange(alive.shape[1])
    return alive & (frames <= end[:, None]) & (frames > (end - length.max(axis=1))[:, None])
