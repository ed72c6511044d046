"""What the operators on an imported object share."""

from typing import Any, cast

import bpy

from ..parts import is_imported

REGISTER_UNDO = {"REGISTER", "UNDO"}


class OnImportedObject:
    """Shared poll of the operators on the active object."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """An imported object must be active, in object mode."""
        return is_imported(context.active_object) and context.active_object.mode == "OBJECT"


class OnOwnObject(OnImportedObject):
    """Shared poll of the operators that change the object."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """It must not belong to another file: what changes there is lost with this session."""
        if not super().poll(context):
            return False
        obj = context.active_object
        if obj.library is None and obj.data.library is None:
            return True
        cast(Any, cls).poll_message_set(  # of bpy.types.Operator, which every user of this class is
            "The object belongs to another file; make it local first"
        )
        return False
