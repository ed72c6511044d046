"""What an imported object remembers, so that everything else can be rebuilt from the model file."""

import bpy

from . import names

CARRIER_ITEMS = (
    (names.ANCHORS, "Anchors", "One point an anchor: light, and what the model moves"),
    (names.GAUSSIANS, "Gaussians", "The local Gaussians of every anchor, as ellipsoids: the look of the trained scene"),
)
PLAYBACK_ITEMS = (
    ("LIVE", "Live", "Evaluated from the model file at every frame"),
    ("BAKED", "Baked", "Played back from attribute keys: needs neither the model file nor this add-on"),
)


class AA4DObjectSettings(bpy.types.PropertyGroup):
    """`Object.aa4d`; `filepath` is empty on objects that were not imported by this add-on."""

    filepath: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Model File",
        description="The model file that this object shows",
        subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    carrier: bpy.props.EnumProperty(name="Carrier", items=CARRIER_ITEMS)  # type: ignore[valid-type]
    playback: bpy.props.EnumProperty(name="Playback", items=PLAYBACK_ITEMS)  # type: ignore[valid-type]


def register() -> None:
    """Register `Object.aa4d`."""
    bpy.utils.register_class(AA4DObjectSettings)
    bpy.types.Object.aa4d = bpy.props.PointerProperty(type=AA4DObjectSettings)


def unregister() -> None:
    """Unregister `Object.aa4d`."""
    del bpy.types.Object.aa4d
    bpy.utils.unregister_class(AA4DObjectSettings)
