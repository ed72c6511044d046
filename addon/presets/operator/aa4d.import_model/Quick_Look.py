import bpy

op = bpy.context.active_operator

op.carrier = "ANCHORS"
op.look = "Points"
op.view = "CAPTURE"
op.import_camera = True
op.background_frames = True
op.set_timeline = True
op.set_up_scene = False
op.trained_picture = False
op.bake = False
