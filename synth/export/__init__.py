"""A rendered plan in the formats that others read. Every exporter is a function of the plan and the truth."""

FORMATS = {
    "tum": "poses.tum: camera trajectory in the format of the TUM RGB-D benchmark",
    "mot": "mot/: tracks of boxes with the columns of VisDrone and of UAVDT",
    "coco": "coco.json: boxes and masks of every frame",
}
