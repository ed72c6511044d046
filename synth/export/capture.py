"""Everything of a capture besides its frames: tracks, points, cameras for others, and the index last."""

import numpy as np
from numpy.typing import NDArray

from synth.capture import INDEX, Folder
from synth.costs import Costs
from synth.export.colmap import colmap_model
from synth.export.index import index, tracks
from synth.export.nerfstudio import transforms
from synth.export.ply import ply
from synth.export.points import build_points, load_views
from synth.files import write_bytes, write_json, write_npz, write_text
from synth.plan import Frame, Plan


def export(plan: Plan, folder: Folder, generator: dict[str, object], costs: Costs) -> None:
    """Write it, from a folder in which every frame is complete."""
    from synth.blender.passes import read_rgb

    def read_truth(frame: Frame) -> dict[str, NDArray]:
        with np.load(folder.truth(frame), allow_pickle=False) as arrays:
            return dict(arrays)

    root = folder.root
    with costs.stage("export"):
        write_npz(root / "truth" / "tracks.npz", **tracks(plan))
        cloud = build_points(load_views(plan, lambda frame: read_rgb(folder.image(frame)), read_truth), plan.K)
        write_bytes(root / "points.ply", ply(cloud))
        write_json(root / "transforms.json", transforms(plan))
        for name, text in colmap_model(plan, cloud).items():
            write_text(root / "sparse" / "0" / name, text)
    costs.save()
    write_json(root / INDEX, index(plan, folder, generator))
