import bpy

op = bpy.context.active_operator

op.carrier = "GAUSSIANS"
op.look = "Gaussians"
op.view = "CAPTURE"
op.import_camera = True
op.background_frames = False
op.set_timeline = True
op.set_up_scene = True
op.trained_picture = True
op.bake = False
