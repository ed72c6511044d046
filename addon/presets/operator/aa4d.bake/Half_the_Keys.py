import bpy

op = bpy.context.active_operator

op.use_range = False
op.step = 2.0
op.inspection = False
