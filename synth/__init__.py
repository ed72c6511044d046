"""From a scene file to a capture: streets, traffic, a drone's flight, and Blender's Cycles to film it.

Only `synth.blender` imports bpy; everything else is numpy and the standard library, and runs without Blender.
"""

__version__ = "0.1.0"
