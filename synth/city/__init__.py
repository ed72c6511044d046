"""What stands in the scene, as plain meshes: streets, buildings, trees, furniture, vehicles. No Blender here."""
