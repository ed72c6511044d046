"""Every name the add-on leaves in a .blend: attributes, keys, groups, modifiers, in one table.

The prefix keeps clear of Blender's own attribute names (an attribute called `color` renders black in Cycles), except
where those are meant.
"""

from collections.abc import Collection
from typing import NamedTuple


class Attribute(NamedTuple):
    """A point attribute of the mesh: its name and Blender's type of it."""

    name: str
    type: str


POSITION = Attribute("position", "FLOAT_VECTOR")  # world metres; Blender's own
COLOR = Attribute("aa_color", "FLOAT_COLOR")  # linear Rec. 709, alpha 1
OPACITY = Attribute("aa_opacity", "FLOAT")  # [0, 1]
RADIUS = Attribute("aa_radius", "FLOAT")  # metres; what a point is drawn with
SCALE = Attribute("aa_scale", "FLOAT_VECTOR")  # standard deviations in metres along the Gaussian's axes
ROTATION = Attribute("aa_rotation", "QUATERNION")  # w x y z
ID = Attribute(
    "aa_id", "INT"
)  # row in the file, of an anchor or of a track's Gaussian; anchor * K + k for a local Gaussian
DISPLACEMENT = Attribute("aa_displacement", "FLOAT")  # metres from the canonical place
SPEED = Attribute("aa_speed", "FLOAT")  # metres a second of the anchor
GROUP = Attribute("aa_group", "INT")  # the vehicle that the anchor rides on, its number from 0; -1 for the world
ACTIVITY = Attribute("aa_activity", "INT")  # the label of the capture's truth; -1 where it has none
SHOWN = Attribute("aa_shown", "BOOLEAN")  # whether the filters let the point through; only in what exports read
# Blender's own, of a point cloud of Gaussian splats: standard deviations, w x y z, and a constant term of spherical
# harmonics with the opacity as its fourth number.
SPLAT_SCALE = Attribute("scale", "FLOAT_VECTOR")
SPLAT_ROTATION = Attribute("rotation", "QUATERNION")
SPLAT_RADIANCE = Attribute("radiance:base", "FLOAT_COLOR")
# What spherical harmonics add to the colour, in sRGB: the constant first, then those of degree 1 to 3.
HARMONICS = tuple(Attribute(f"aa_sh_{index:02}", "FLOAT_VECTOR") for index in range(16))
SPLAT_HARMONICS_PREFIX = "radiance:sh_"  # Blender's own, counted from 0 at the first of degree 1
TRAIL = Attribute("aa_trail", "INT")  # how many earlier positions there are
TRAIL_PREFIX = "aa_trail_"
PLANES = ("xy", "xz", "yz", "xt", "yt", "zt")
WEIGHTS = tuple(Attribute(f"aa_weight_{plane}", "FLOAT") for plane in PLANES)  # of ACFA, mean over the channels


class Key(NamedTuple):
    """A baked attribute: `prefix` + four digits of the key's number holds the value of `attribute` there."""

    attribute: Attribute
    prefix: str
    type: str


# Opacity rides in the alpha of the colour key. Eight bits a channel, sRGB-encoded by Blender: what the model is
# trained on, at a quarter of the memory of floats.
KEYS = (
    Key(POSITION, "aa_x_", "FLOAT_VECTOR"),
    Key(COLOR, "aa_c_", "BYTE_COLOR"),
    Key(RADIUS, "aa_r_", "FLOAT"),
    Key(SCALE, "aa_s_", "FLOAT_VECTOR"),
    Key(ROTATION, "aa_q_", "QUATERNION"),
    Key(DISPLACEMENT, "aa_d_", "FLOAT"),
    Key(SPEED, "aa_v_", "FLOAT"),
    *(Key(weight, f"aa_w{plane}_", "FLOAT") for weight, plane in zip(WEIGHTS, PLANES, strict=True)),
    *(Key(term, f"aa_h{index:02}_", "FLOAT_VECTOR") for index, term in enumerate(HARMONICS)),
)
UNFINISHED = "aa_unfinished_"  # before the name of a key while its bake runs

ANCHORS = "ANCHORS"
GAUSSIANS = "GAUSSIANS"

APPEARANCE = (POSITION, COLOR, OPACITY, RADIUS)  # what every look needs
SHAPE = (SCALE, ROTATION)  # what discs and Gaussians need as well
INSPECTION = (DISPLACEMENT, SPEED, *WEIGHTS)  # evaluated only where something shows them or filters by them

TIME_MODIFIER = "AdaAnchor4D Time"
LOOK_MODIFIER = "AdaAnchor4D"

VERSION_PROPERTY = "aa_version"  # on node groups and materials: which version of the builder made them
STAMP_PROPERTY = "aa_stamp"  # on the mesh: what its attributes were evaluated for
PLACED_PROPERTY = "aa_placed"  # on the mesh: the time that its positions were evaluated for, and their checksum
MAP_PROPERTY = "aa_map"  # on the mesh: 4 x 4 numbers, from the model's metres to the mesh's; absent where they agree

KEPT_PROPERTY = "aa_kept"  # on a scene that shows the trained picture: its settings before that
BACKGROUND_PROPERTY = "aa_background"  # on the world that an import made: the model's background, sRGB and linear

FIRST_FRAME = 1  # the timeline's frame of the clip's first frame, unless a person moves it


def trail_name(age: int) -> str:
    """The attribute that holds the position `age` frames before."""
    return f"{TRAIL_PREFIX}{age:02}"


def keys_of(attributes: Collection[Attribute]) -> tuple[Key, ...]:
    """The keys that hold these attributes."""
    return tuple(key for key in KEYS if key.attribute in attributes)


def key_name(key: Key, number: int) -> str:
    """The attribute that holds `key` at the key of this number."""
    return f"{key.prefix}{number:04}"
