"""The Blender extension: trained AdaAnchor4D scenes on the timeline. This file only registers."""


def register() -> None:
    """Add the operators, the panel, the menu entry, drag and drop, and the playback handler to Blender."""
    # Imported here and not above: the modules without bpy (model, field, carriers) also serve programs outside Blender.
    from . import operators, other_blenders, panel, playback, properties, translations

    translations.register()
    properties.register()
    operators.register()
    panel.register()
    playback.register()
    other_blenders.register()


def unregister() -> None:
    """Take everything out again. Blender 4.5 as a module hangs at exit where this was not called."""
    from . import operators, other_blenders, panel, playback, properties, translations

    other_blenders.unregister()
    playback.unregister()
    panel.unregister()
    operators.unregister()
    properties.unregister()
    translations.unregister()
