"""Every name the add-on leaves in a .blend: attributes, keys, groups, modifiers, in one table.

The prefix keeps clear of Blender's own attribute names (an attribute called `color` renders black in Cycles).
"""

from typing import NamedTuple


class Attribute(NamedTuple):
    """A point attribute of the mesh: its name and Blender's type of it."""

    name: str
    type: str


POSITION = Attribute("position", "FLOAT_VECTOR")  # world metres; Blender's own
COLOR = Attribute("aa_color", "FLOAT_COLOR")  # linear Rec. 709, alpha 1
OPACITY = Attribute("aa_opacity", "FLOAT")  # [0, 1]
RADIUS = Attribute("aa_radius", "FLOAT")  # metres; what a point is drawn with
DISPLACEMENT = Attribute("aa_displacement", "FLOAT")  # metres from the canonical place
SCALE = Attribute("aa_scale", "FLOAT_VECTOR")  # standard deviations in metres along the Gaussian's axes
ROTATION = Attribute("aa_rotation", "QUATERNION")  # w x y z
ID = Attribute("aa_id", "INT")  # the anchor's row in the model file; anchor * K + k for a local Gaussian


class Key(NamedTuple):
    """A baked attribute: `prefix` + four digits of the frame's rank holds the value of `attribute` at that frame."""

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
)

ANCHORS = "ANCHORS"
GAUSSIANS = "GAUSSIANS"

# The attributes that change with time, for each carrier.
CARRIER_ATTRIBUTES: dict[str, tuple[Attribute, ...]] = {
    ANCHORS: (POSITION, COLOR, OPACITY, RADIUS, DISPLACEMENT),
    GAUSSIANS: (POSITION, COLOR, OPACITY, SCALE, ROTATION, DISPLACEMENT),
}

LOOK_MODIFIER = "AdaAnchor4D"
KEYS_MODIFIER = "AdaAnchor4D Keys"

VERSION_PROPERTY = "aa_version"  # on node groups and materials: which version of the builder made them
TIME_PROPERTY = "aa_time"  # on the mesh: the t that its attributes were evaluated at

FIRST_FRAME = 1  # the timeline's frame of the clip's first frame


def carrier_keys(carrier: str) -> tuple[Key, ...]:
    """The keys that a bake of this carrier writes."""
    return tuple(key for key in KEYS if key.attribute in CARRIER_ATTRIBUTES[carrier])


def key_name(key: Key, rank: int) -> str:
    """The attribute that holds `key` at the frame of this rank."""
    return f"{key.prefix}{rank:04}"
