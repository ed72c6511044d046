"""What the points of an imported object carry: the values of every attribute at one time, as numpy arrays.

Two carriers: the anchors, one point each, and the local Gaussians, K points an anchor.
"""

import numpy as np

from . import names
from .container import Floats
from .field import AnchorState, Field, LocalGaussians, anchor_state, local_gaussians, to_world

# How many standard deviations of its Gaussians an anchor's point reaches: fewer leave gaps, more hide small neighbours.
RADIUS_SIGMAS = 1.5


def point_count(field: Field, carrier: str) -> int:
    """How many points the carrier has."""
    return field.model.anchor_count * (field.model.config.offsets if carrier == names.GAUSSIANS else 1)


def evaluate(field: Field, carrier: str, t: float) -> dict[names.Attribute, Floats]:
    """Every attribute of the carrier at time t, one row a point; as the capture's camera sees them."""
    state = anchor_state(field, t)
    gaussians = local_gaussians(field, state, field.model.camera_center_at(t))
    displacement = np.float32(field.model.scale) * np.linalg.norm(
        state.positions - field.model.tensors["anchors.position"], axis=1
    )
    if carrier == names.ANCHORS:
        return _anchors(field, state, gaussians, displacement)
    K = field.model.config.offsets
    return {
        names.POSITION: gaussians.positions.reshape(-1, 3),
        names.COLOR: linear_rgba(gaussians.colors.reshape(-1, 3)),
        names.OPACITY: np.maximum(gaussians.opacities, 0).reshape(-1),
        names.SCALE: gaussians.scales.reshape(-1, 3),
        names.ROTATION: gaussians.quaternions.reshape(-1, 4),
        names.DISPLACEMENT: np.repeat(displacement, K),
    }


def _anchors(
    field: Field, state: AnchorState, gaussians: LocalGaussians, displacement: Floats
) -> dict[names.Attribute, Floats]:
    """One point an anchor: its Gaussians' colours weighted by their opacity, the opacity of the most opaque one.

    The radius is the opacity-weighted mean of what each Gaussian covers: the geometric mean of its two largest standard
    deviations, since most are flat.
    """
    opacity = np.maximum(gaussians.opacities, 0)
    share = opacity + np.float32(1e-6)  # an anchor without a visible Gaussian keeps the plain mean
    share /= share.sum(axis=1, keepdims=True)
    ordered = np.sort(gaussians.scales, axis=2)
    reach = np.sqrt(ordered[..., 1] * ordered[..., 2])
    return {
        names.POSITION: to_world(field.model, state.positions),
        names.COLOR: linear_rgba(np.einsum("nk,nkc->nc", share, gaussians.colors)),
        names.OPACITY: opacity.max(axis=1),
        names.RADIUS: np.float32(RADIUS_SIGMAS) * (share * reach).sum(axis=1),
        names.DISPLACEMENT: displacement,
    }


def linear_rgba(srgb: Floats) -> Floats:
    """sRGB colours [n, 3] as linear ones with alpha 1, [n, 4] (IEC 61966-2-1)."""
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return np.concatenate([linear, np.ones_like(linear[:, :1])], axis=1).astype(np.float32)
