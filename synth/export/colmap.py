"""sparse/0: cameras, images and points with their tracks as a COLMAP text model.

Format: https://colmap.github.io/format.html. Ids count from 1.
"""

import numpy as np

from synth.camera import quaternion, same_hemisphere
from synth.export.points import PointCloud
from synth.plan import Plan


def colmap_model(plan: Plan, cloud: PointCloud) -> dict[str, str]:
    """The text of cameras.txt, images.txt and points3D.txt by file name."""
    camera, K = plan.scene.camera, plan.K
    bent = plan.lens.document().get("distortion")
    values = [K[0, 0], K[1, 1], K[0, 2], K[1, 2]]
    model = "PINHOLE"
    if bent:
        model = "FULL_OPENCV"
        values += [bent["k1"], bent["k2"], bent["p1"], bent["p2"], bent["k3"], 0, 0, 0]
    numbers = " ".join(repr(float(v)) for v in values)
    cameras = [f"1 {model} {camera.width_px} {camera.height_px} {numbers}"]

    order = np.lexsort((cloud.point_of, cloud.rank_of))
    rank_of, point_of, pixels = cloud.rank_of[order], cloud.point_of[order], cloud.pixels[order]
    quaternions = same_hemisphere(np.stack([quaternion(frame.viewmat[:3, :3]) for frame in plan.frames]))
    tracks: list[list[str]] = [[] for _ in cloud.positions]
    images = []
    for frame, rotation in zip(plan.frames, quaternions, strict=True):
        start, end = np.searchsorted(rank_of, (frame.rank, frame.rank + 1))
        pose = " ".join(repr(float(v)) for v in (*rotation, *frame.viewmat[:3, 3]))
        images.append(f"{frame.rank + 1} {pose} 1 {frame.name}.png")
        seen = zip(pixels[start:end], point_of[start:end], strict=True)
        images.append(" ".join(f"{x:.3f} {y:.3f} {point + 1}" for (x, y), point in seen))
        for position, point in enumerate(point_of[start:end]):
            tracks[point].append(f"{frame.rank + 1} {position}")

    points = [
        f"{i + 1} {x!r} {y!r} {z!r} {r} {g} {b} 0 {' '.join(track)}"
        for i, ((x, y, z), (r, g, b), track) in enumerate(
            zip(cloud.positions.tolist(), cloud.colours.tolist(), tracks, strict=True)
        )
    ]
    return {
        "cameras.txt": "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n" + "\n".join(cameras) + "\n",
        "images.txt": "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then X Y POINT3D_ID ...\n"
        + "\n".join(images)
        + "\n",
        "points3D.txt": "# POINT3D_ID X Y Z R G B ERROR, then IMAGE_ID POINT2D_IDX ...\n" + "\n".join(points) + "\n",
    }
