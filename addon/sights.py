"""What the capture's cameras see of the local Gaussians at one time, each from its side. No bpy here.

A Gaussian's harmonics are what to add to the colour that it has from one eye, so that every camera that was trained on
sees what it saw; `aa4d export --harmonics` fits the same function.
"""

from collections.abc import Iterator

import numpy as np

from . import harmonics
from .container import Floats
from .field import AnchorState, Field, LocalGaussians, appearance_from
from .header import Doubles
from .products import over_chunks
from .splat_ply import FAINTEST

MOST_EYES = 48  # that harmonics are fitted over
ROWS = 2048  # Gaussians at a time


def eyes_of(field: Field, *, held_out: bool) -> Doubles:
    """Places [E, 3], metres, of the cameras that were trained on, or of those that were not; some of many."""
    centers = field.model.camera_centers[field.model.held_out == held_out]
    return centers[:: max(-(-len(centers) // MOST_EYES), 1)]


def fitted_over_cameras(field: Field, state: AnchorState, gaussians: LocalGaussians, degree: int) -> Floats:
    """[N * K, (degree + 1)^2, 3] of sRGB, what harmonics add to the colours; 0 for what is too faint to draw.

    What is opaque from a camera counts there. `state` and `gaussians` are of one time.
    """
    eyes = eyes_of(field, held_out=False)
    seen_by = appearance_from(field, state, eyes)

    def fit(part: slice) -> Floats:
        colors, opacities = seen_by(part)
        found = np.zeros((*gaussians.opacities[part].shape, harmonics.count(degree), 3), np.float32)
        drawn = gaussians.opacities[part] >= FAINTEST
        places, before = gaussians.positions[part][drawn], gaussians.colors[part][drawn]
        colors, opacities, fits = colors[drawn], opacities[drawn], []
        for rows in _rows(len(places)):
            directions = harmonics.directions_from(eyes, places[rows].astype(np.float64))
            more = colors[rows].astype(np.float64) - before[rows, None]
            fits.append(harmonics.fitted(directions, more, opacities[rows].astype(np.float64), degree))
        if fits:
            found[drawn] = np.concatenate(fits)
        return found.reshape(-1, *found.shape[2:])

    return np.concatenate(over_chunks(len(state.positions), fit))


def color_errors(
    field: Field, state: AnchorState, gaussians: LocalGaussians, coefficients: Floats
) -> tuple[float, float] | None:
    """By how much colours are off as the held-out cameras see them, with the harmonics and without; None without such.

    The root of the mean square over cameras and channels, weighted by opacity.
    """
    eyes = eyes_of(field, held_out=True)
    if not len(eyes):
        return None
    seen_by = appearance_from(field, state, eyes)
    each = coefficients.reshape(*gaussians.opacities.shape, *coefficients.shape[1:])

    def sums(part: slice) -> Doubles:
        colors, opacities = seen_by(part)
        drawn = gaussians.opacities[part] >= FAINTEST
        places, before = gaussians.positions[part][drawn], gaussians.colors[part][drawn]
        colors, opacities, terms = colors[drawn], opacities[drawn].astype(np.float64), each[part][drawn]
        total = np.zeros(3)
        for rows in _rows(len(places)):
            directions = harmonics.directions_from(eyes, places[rows].astype(np.float64))
            more = harmonics.valued(terms[rows].astype(np.float64), directions)
            for index, shown in enumerate((before[rows, None] + more, before[rows, None])):
                off = np.clip(shown, 0, 1) - colors[rows]
                total[index] += (opacities[rows, :, None] * off**2).sum()
        total[2] = 3 * opacities.sum()
        return total

    fitted, frozen, weight = np.sum(over_chunks(len(state.positions), sums), axis=0)
    return float(np.sqrt(fitted / max(weight, 1e-12))), float(np.sqrt(frozen / max(weight, 1e-12)))


def _rows(count: int) -> Iterator[slice]:
    return (slice(start, start + ROWS) for start in range(0, count, ROWS))
