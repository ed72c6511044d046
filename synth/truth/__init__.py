"""Ground truth: arrays in, arrays out. docs/truth.md defines every pass."""

PASSES = {
    "depth_z": "planar depth in meters (always written: the point cloud is made from it)",
    "instance_id": "whose pixel it is (always written)",
    "normal": "unit surface normals in world axes, facing the camera",
    "class_id": "what kind of thing each pixel shows",
    "flow": "forward and backward flow in pixels, with validity masks",
    "occlusion": "whether what a pixel shows is seen in the next and in the previous frame",
    "visible_pixels": "pixels of every instance in every frame",
    "boxes": "boxes of every instance in every frame: corners in the world, in pixels, visible part",
    "activity": "static, intermittent, persistent, appearance-only or unseen: per pixel, ground cell and time",
}
ALWAYS = ("depth_z", "instance_id")
