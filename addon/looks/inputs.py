"""The inputs of the look modifier."""

from .. import harmonics, materials
from ..node_tree import Tree
from . import (
    COLOR_BY,
    CROP,
    CROP_OBJECT,
    FARTHEST,
    HARMONICS,
    HIGH,
    LIT,
    LOOK,
    LOW,
    MINIMUM_OPACITY,
    NEAREST,
    NO_CROP,
    NO_LIMIT_M,
    PAINT,
    PAINT_SHARE,
    PLANE,
    SIZE,
    SOFTNESS,
    SPLATS_KNOWN,
    TRAIL_DISTANCE,
    TRAINED_PICTURE,
    USUAL_OPACITY,
)
from .colors import TRAINED


def make_inputs(tree: Tree) -> None:
    tree.make_input(LOOK, "Menu", "What is drawn at every point", default_value=materials.POINTS)
    tree.make_input(
        SIZE,
        "Float",
        "How large to draw, relative to the trained size",
        default_value=1.0,
        min_value=0.0,
        max_value=100.0,
    )
    tree.make_input(LIT, "Bool", "Take light and shadows from the scene, instead of glowing in the trained colours")
    tree.open_panel("Colour")
    tree.make_input(COLOR_BY, "Menu", "What the colours show", default_value=TRAINED)
    tree.make_input(PLANE, "Menu", "The plane whose weight is shown", default_value="xt")
    tree.make_input(LOW, "Float", "The value at the legend's left end")
    tree.make_input(HIGH, "Float", "The value at the legend's right end", default_value=1.0)
    tree.make_input(
        PAINT,
        "Color",
        "Hue and saturation to give the points; how light they are stays",
        default_value=(0.8, 0.02, 0.02, 1),
    )
    tree.make_input(
        PAINT_SHARE,
        "Float",
        "How much of the paint is taken",
        default_value=0.0,
        min_value=0.0,
        max_value=1.0,
        subtype="FACTOR",
    )
    tree.open_panel("Filter")
    tree.make_input(
        MINIMUM_OPACITY,
        "Float",
        "Points less opaque than this are not drawn",
        default_value=USUAL_OPACITY,
        min_value=0.0,
        max_value=1.0,
    )
    for name, description, default in (
        (NEAREST, "Anchors nearer to their canonical place than this are not drawn, metres", 0.0),
        (FARTHEST, "Anchors farther from their canonical place than this are not drawn, metres", NO_LIMIT_M),
    ):
        tree.make_input(name, "Float", description, default_value=default, min_value=0.0, subtype="DISTANCE")
    tree.make_input(CROP, "Menu", "Draw a part of the scene", default_value=NO_CROP)
    tree.make_input(CROP_OBJECT, "Object", "An empty or a cube: its box is -1 to 1 on each of its axes")
    tree.make_input(
        TRAIL_DISTANCE,
        "Float",
        "Ghosts nearer to their anchor than this are not drawn, metres",
        default_value=0.2,
        min_value=0.0,
        subtype="DISTANCE",
    )
    # What is new stands last, so that the numbers by which a modifier keeps the others stay.
    tree.panel = None
    tree.make_input(
        TRAINED_PICTURE,
        "Bool",
        "Blend sRGB values, as training does: the colours are encoded once more, for the view transform Raw. "
        "Set it with the button of this name, which sets the scene too",
    )
    tree.make_input(
        SOFTNESS,
        "Float",
        "How much wider Gaussians are drawn, as a share of their depth: the width of the filter that they were trained "
        "with, which thin ones need; set by the import",
        default_value=0.0,
        min_value=0.0,
        max_value=1.0,
    )
    if SPLATS_KNOWN:
        tree.make_input(
            HARMONICS,
            "Int",
            "Degree of the spherical harmonics by which colours of Native Splats follow every camera, fitted to what "
            "the capture's cameras see; with 0 they are those of Seen From",
            default_value=0,
            min_value=0,
            max_value=harmonics.HIGHEST,
        )
