import bpy

op = bpy.context.active_operator

op.use_range = False
op.step = 1.0
op.inspection = True
