"""Ground that something drives over at another time: where a model leaves ghosts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from aa4d.capture.reader import Capture
from aa4d.capture.truth import ObjectTracks, depth_of, instance_ids_of, object_tracks
from aa4d.evaluation.ground_cells import MOVING, GroundCells, ground_cells
from aa4d.evaluation.surface import surface_points
from aa4d.evaluation.true_motion import true_viewmats

LEVEL_M = 0.3  # between a surface and the height at which movers pass: kerbs count, crowns of trees do not


class SweptGround:
    """The swept ground of a capture, frame by frame."""

    def __init__(self, capture: Capture) -> None:
        """Raises InputError for damaged truth."""
        self._capture = capture
        self._cells, tracks = ground_cells(capture), object_tracks(capture)
        ways = None if tracks is None else _ways(tracks)
        self._ways = None if ways is None or not len(ways) else (cKDTree(ways[:, :2]), ways[:, 2])
        self._viewmats = true_viewmats(capture) if self._cells is not None else None

    def of_frame(self, index: int) -> NDArray[np.bool_] | None:
        """Pixels [H, W]; None where the capture lacks truth of activity, depth or tracks, or nothing in it moves.

        Raises:
            InputError: the truth is damaged.
        """
        depth, instance_id = depth_of(self._capture, index), instance_ids_of(self._capture, index)
        if self._cells is None or self._viewmats is None or self._ways is None or depth is None or instance_id is None:
            return None
        places = surface_points(self._capture.camera.K, self._viewmats[index], depth)
        swept = (instance_id == 0) & _swept(self._cells, index, places)
        tree, heights = self._ways
        nearest = tree.query(places[swept][:, :2])[1]
        swept[swept] = np.abs(places[swept][:, 2] - heights[nearest]) < LEVEL_M
        return swept


def _ways(tracks: ObjectTracks) -> NDArray[np.float64]:
    """World points [P, 3] on the ground where instances move."""
    return tracks.object_to_world[tracks.moving & tracks.present][:, :3, 3]


def _swept(cells: GroundCells, index: int, places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Points [...] over cells that something moves over in the clip, but not now."""
    at = cells.below(places)
    now, ever = cells.active[index].ravel(), np.isin(cells.label.ravel(), MOVING)
    return (at >= 0) & ever[at] & ~now[at]
