"""Advice for a reconstruction that fails or is poor; the console and the report say the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from aa4d.capture.focal import Tried, contradicts, field_of_view_deg
from aa4d.capture.horizon import Horizon
from aa4d.capture.selection import abbreviate

NOTHING_RECONSTRUCTED = "no cameras could be reconstructed"
GOOD_SHARE = 0.95
GOOD_ERROR_PX = 1.0
TURNING = ("PANORAMIC", "PLANAR_OR_PANORAMIC")
FLAT = ("PLANAR", *TURNING)
MANY_SHARE = 0.3  # Share of the frames that show the horizon
TILT_DEG = 6.0  # Angle of the ground against the horizon: roads climb by less
STEEP_DEG = 30.0  # the same: no ground that is filmed from above slopes by so much
OTHER_FOCAL = 0.15  # share by which frames may change the focal length that EXIF states
FLAT_SHARE = 0.9  # fraction of the pairs: with more, next to nothing in the frames tells the focal length


@dataclass(frozen=True)
class Advice:
    """A sentence for the console and the report, and one that only the report adds."""

    what: str
    why: str = ""


def no_model_advice(geometry: dict[str, int], is_stated: bool) -> str:
    """Why there is no model, from the kinds of two-view geometry among the matched pairs.

    Args:
        is_stated: whether the field of view is what the user says.
    """
    doubts = is_stated and sum(geometry.values()) > 0  # frames that do not match say nothing of it
    return _missing_from(geometry) + ("; or --fov is not the camera's: leave it out" if doubts else "")


def _missing_from(geometry: dict[str, int]) -> str:
    pairs = sum(geometry.values())
    if pairs == 0:
        return (
            "no two frames have enough in common; use frames that lie closer together (--rate), larger ones "
            "(--longest-px), or a part of the clip with texture and daylight"
        )
    if sum(geometry.get(kind, 0) for kind in TURNING) > 0.5 * pairs:
        return (
            "the camera only turns or stands still, so that nothing shows how far away things are; use a part of the "
            "clip in which the drone flies sideways or along an arc (--start, --end)"
        )
    return (
        "the frames match but no pair shows enough parallax to start from; use more of the clip, frames further apart "
        "(--rate), or --preset accurate"
    )


def field_of_view_advice(
    geometry: dict[str, int], fov_deg: float, was_kept: bool, rivals: Sequence[Tried] = ()
) -> list[Advice]:
    """Advice on a focal length that nobody stated, where the frames themselves hardly tell it.

    Args:
        rivals: other fields of view that a part of the frames was explained by as well.
    """
    pairs, flat = sum(geometry.values()), sum(geometry.get(kind, 0) for kind in FLAT)
    if not was_kept and not rivals and flat <= FLAT_SHARE * pairs:
        return []
    origin = "are the usual ones, taken because the frames gave impossible ones," if was_kept else "were found here"
    what = (
        f"The field of view, {fov_deg:.0f} degrees, is doubtful, and all heights with it: the frames hardly tell it. "
        "If you know the camera's, give --fov."
    )
    why = (
        f"{flat} of {pairs} pairs look like pictures of one plane (the ground is flat, or little way was flown between "
        f"them). The {fov_deg:.0f} degrees that {origin} can be far off, however low the reprojection error is."
    )
    if rivals and not was_kept and flat <= FLAT_SHARE * pairs:
        others = " and ".join(f"{rival.fov_deg:.0f} degrees ({rival.error_px:.2f} px)" for rival in rivals)
        why = f"A part of the frames is explained by {others} about as well."
    return [Advice(what, why)]


def stated_field_of_view_advice(held: Tried, freed: Tried) -> list[Advice]:
    """Advice on a stated field of view that the frames contradict."""
    if not contradicts(held, freed):
        return []
    what = (
        f"--fov {held.fov_deg:.3g} contradicts the frames: it explains them to {held.error_px:.2f} px, and "
        f"{freed.fov_deg:.0f} degrees would to {freed.error_px:.2f} px. Is it the camera's, horizontally and with "
        "this zoom? Without --fov it is found."
    )
    return [Advice(what)]


def exif_advice(focal_share: float, focal_px: float, width: int, height: int) -> list[Advice]:
    """Advice on frames that gave another focal length than EXIF's: a share of the longest side."""
    stated_px = focal_share * max(width, height)
    if abs(focal_px / stated_px - 1) <= OTHER_FOCAL:
        return []
    stated, found = (field_of_view_deg(width, px) for px in (stated_px, focal_px))
    what = (
        f"EXIF says a field of view of {stated:.0f} degrees, and the frames gave {found:.0f}: heights are doubtful. "
        f"Give --fov {stated:.0f} to hold it, if the pictures are uncut."
    )
    return [Advice(what)]


def standing_out_advice(labels: list[str]) -> list[Advice]:
    """Advice on frames that do not fit to those around them."""
    if not labels:
        return []
    what = (
        f"{abbreviate(labels)}: out of line with the frames around, in error or in direction. The cameras may be wrong "
        "there: look at the 3D view in the report, try --preset accurate, or leave them out (--start, --end)."
    )
    return [Advice(what)]


def horizon_advice(horizon: Horizon | None, labels: list[str]) -> list[Advice]:
    """Advice on cameras that the horizon contradicts; `labels` of all frames."""
    if horizon is None:
        return []
    seen = f"what looks like the horizon in {horizon.seen} of {len(labels)} frames"
    turned = f"turned against each other by up to {horizon.spread_deg:.0f} degrees"
    if len(horizon.apart) > MANY_SHARE * horizon.seen:
        return [_all_wrong(f"by {seen}, they are {turned}")]
    if horizon.apart:
        names = abbreviate([labels[i] for i in horizon.apart])
        what = f"{names}: by {seen}, these cameras and the others are {turned}. Leave them out (--start, --end)."
        return [Advice(what)]
    if horizon.tilt_deg > STEEP_DEG:
        return [_all_wrong(f"the ground that they make is {horizon.tilt_deg:.0f} degrees off {seen}")]
    if horizon.tilt_deg > TILT_DEG:
        what = (
            f"The world's up is {horizon.tilt_deg:.0f} degrees off {seen}: the ground slopes, or the field of view is "
            "wrong; if you know it, give --fov."
        )
        return [Advice(what)]
    return []


def _all_wrong(because: str) -> Advice:
    what = (
        f"The cameras are wrong: {because}. Use a part of the clip in which the drone flies sideways or along an arc "
        "(--start, --end), --preset accurate, or --fov if you know the camera's."
    )
    return Advice(what, "An outline that is no horizon, such as the edge of a long roof, can be the reason.")


def advice(
    registered_share: float, error_px: float, other_models: int, gaps: int, blurred: int, overlay: str | None = None
) -> list[Advice]:
    """Advice for a poor reconstruction; empty where it is good. `overlay`: the note on what is burned in."""
    said: list[str] = []
    if other_models:
        said.append(
            "The clip falls into parts that could not be joined: a cut, a fast turn, or too little overlap. Capture "
            "the parts on their own (--start, --end), or raise --rate so that neighboring frames overlap."
        )
    if registered_share < GOOD_SHARE and not other_models:
        said.append(
            "Some frames could not be placed. Try --preset accurate, a higher --rate, or leave out the stretch with "
            "little texture (water, fields from far above, night)."
        )
    if gaps:
        said.append("Some neighboring frames have nothing in common: raise --rate, or check for a cut there.")
    if error_px > GOOD_ERROR_PX:
        said.append(
            "The reprojection error is high: rolling shutter, a zoom during the clip or strong electronic "
            "stabilization. Switch stabilization off when filming, fly slower, and use one zoom setting."
        )
    if overlay is not None:
        said.append(f"{overlay[0].upper()}{overlay[1:]}.")
    if blurred > 0:
        said.append("Blurred frames were left out: a shorter exposure gives sharper ones.")
    return [Advice(what) for what in said]
