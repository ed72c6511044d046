"""What an imported object remembers, so that everything else can be rebuilt from the model file."""

import bpy

from . import names, source

CARRIER_ITEMS = (
    (names.ANCHORS, "Anchors", "One point an anchor: light, and what the model moves"),
    (names.GAUSSIANS, "Gaussians", "The local Gaussians of every anchor: the trained scene in full"),
)
KIND_ITEMS = (
    (source.MODEL, "Model", "A model of anchors, evaluated at any time and as any camera sees it"),
    (source.TRACK, "Track", "The Gaussians that a model of any method shows at key times, in colours that stay"),
)
PLAYBACK_ITEMS = (
    ("LIVE", "Live", "Evaluated from the model file at every frame"),
    ("BAKED", "Baked", "Played back from attribute keys: needs neither the model file nor this add-on"),
)
CAPTURE, ACTIVE, FROZEN = "CAPTURE", "ACTIVE", "FROZEN"
VIEW_ITEMS = (
    (CAPTURE, "Capture's Camera", "What depends on the view is as the drone saw it at that time"),
    (ACTIVE, "Active Camera", "What depends on the view follows the scene's active camera"),
    (FROZEN, "Frozen", "What depends on the view stays as seen from one place, wherever a camera goes"),
)


class AA4DObjectSettings(bpy.types.PropertyGroup):
    """`Object.aa4d`; `filepath` is empty on objects that were not imported by this add-on."""

    filepath: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Model File",
        description="The model file that this object shows",
        subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    last_place: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Last Place", description="Where the model file was found last, for when the relative path fails"
    )
    content: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Content", description="The hash of the model file that this object was made from"
    )
    kind: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Kind", description="What kind of file this object shows", items=KIND_ITEMS
    )
    fps: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Frame Rate", description="Frames a second of the clip that the speed was set for", min=0.0
    )
    carrier: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Carrier", description="What the points stand for", items=CARRIER_ITEMS
    )
    playback: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Playback", description="Where the points' places and colours come from", items=PLAYBACK_ITEMS
    )
    view: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Seen From", description="The place that view-dependent colours are evaluated for", items=VIEW_ITEMS
    )
    frozen_view: bpy.props.FloatVectorProperty(  # type: ignore[valid-type]
        name="Frozen Place", description="Where the frozen view is, in world metres", subtype="TRANSLATION", size=3
    )


def register() -> None:
    """Register `Object.aa4d`."""
    bpy.utils.register_class(AA4DObjectSettings)
    bpy.types.Object.aa4d = bpy.props.PointerProperty(type=AA4DObjectSettings)


def unregister() -> None:
    """Unregister `Object.aa4d`."""
    del bpy.types.Object.aa4d
    bpy.utils.unregister_class(AA4DObjectSettings)
