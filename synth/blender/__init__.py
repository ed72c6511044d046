"""Everything that talks to Blender: build the scene, place what moves, render, read the passes."""
