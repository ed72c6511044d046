"""The looks of imported points: what the modifier draws at them, and the names of its inputs."""

import bpy

from .. import materials

VERSION = 9  # Version of the node groups
# From 5.3 on Blender draws Gaussians itself. Files go from one Blender to another: the group of one that knows the look
# is not taken for that of one that does not.
SPLATS_KNOWN = hasattr(bpy.types, "GeometryNodePointsSetType")
EDITION = f"{VERSION} with splats" if SPLATS_KNOWN else f"{VERSION}"
LOOK, SIZE, LIT = "Look", "Size", "Lit"
COLOR_BY, PLANE, LOW, HIGH = "Colour By", "Plane", "Low", "High"
PAINT, PAINT_SHARE = "Paint", "Paint Strength"
MINIMUM_OPACITY, NEAREST, FARTHEST = "Minimum Opacity", "Moved at Least", "Moved at Most"
CROP, CROP_OBJECT = "Crop", "Crop Object"
NO_CROP, INSIDE, OUTSIDE = "Off", "Inside", "Outside"
TRAIL_DISTANCE = "Ghost Distance"
TRAINED_PICTURE, SOFTNESS, HARMONICS = "Trained Picture", "Softness", "Harmonics"

LOOKS = {
    materials.POINTS: "Spheres of the size of what they stand for; the fastest",
    materials.DISCS: "Opaque discs across the thinnest direction of the Gaussians",
    materials.GAUSSIANS: "Ellipsoids with the exact Gaussian falloff; in the trained picture, what aa4d render draws",
}
if SPLATS_KNOWN:
    LOOKS[materials.SPLATS] = "Gaussians that Blender draws itself, as a point cloud of splats: the fastest of them"
NO_LIMIT_M = 1e6
USUAL_OPACITY = 0.05  # fainter points hardly show, and cost as much as others
