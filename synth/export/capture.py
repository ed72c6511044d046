"""Everything of a capture besides its frames: derived truth, points, cameras for others, and the index last."""

import dataclasses
import hashlib
from typing import Any

import numpy as np

from synth.capture import INDEX, PLAN, SECOND, Folder
from synth.costs import Costs
from synth.develop import png
from synth.effects import at
from synth.export.colmap import colmap_model
from synth.export.index import index, measured_viewmats, rows, tracks
from synth.export.nerfstudio import transforms
from synth.export.ply import ply
from synth.export.points import build_points, load_views
from synth.files import write_bytes, write_json, write_npz, write_text
from synth.identity import capture_identity
from synth.ledger import CHECKSUMS, LEDGER
from synth.plan import Plan
from synth.progress import Progress
from synth.truth.derive import derive, steps

COSTS = "cost.json"


def export(plan: Plan, folder: Folder, plan_document: dict[str, Any], scene_file: str, costs: Costs) -> None:
    """Write it, from a folder in which every frame is complete; `plan_document` is `plan.document`."""
    from synth.blender.passes import read_rgb

    root = folder.root
    for effect in at(plan.effects, "encode"):
        with costs.stage("encode"), costs.effect(effect.name):
            effect.module.encode(effect.settings, plan, folder)
    progress = Progress("truth", max(1, steps(plan)))
    passes = derive(plan, folder, costs, progress.advance)
    with costs.stage("export"):
        write_npz(root / "truth" / "tracks.npz", **tracks(plan))
        if plan.shutter.readout_s > 0:
            write_npz(root / "truth" / "rows.npz", **rows(plan))
        cloud = build_points(
            load_views(plan, lambda frame: read_rgb(folder.image(frame)), folder.read_truth), plan.lens
        )
        write_bytes(root / "points.ply", ply(cloud))
        reported = plan_with_reported_poses(plan)
        write_json(root / "transforms.json", transforms(reported))
        for name, text in colmap_model(reported, cloud).items():
            write_text(root / "sparse" / "0" / name, text)
        for name in plan.scene.exports:
            _annotations(name, reported, folder)
        masks = [e.module.covers(e.settings, plan) for e in plan.effects if hasattr(e.module, "covers")]
        if masks:
            covered = np.logical_or.reduce(masks).astype(np.uint8) * np.uint8(255)
            write_bytes(root / "left_out" / "all.png", png(covered))
    costs.save()
    files = checksums(folder)
    write_json(root / CHECKSUMS, files)
    generator = {**plan_document["generator"], "scene": scene_file, "seed": plan.scene.seed}
    content = index(plan, folder, generator, passes)
    identity = capture_identity(content, files, {"plan": plan_document["sha256"]})
    write_json(root / INDEX, {**content, "identity": identity})
    (root / LEDGER).unlink(missing_ok=True)


def plan_with_reported_poses(plan: Plan) -> Plan:
    """The plan with the poses that the capture gives for the true ones."""
    measured = measured_viewmats(plan)
    if measured is None:
        return plan
    frames = tuple(dataclasses.replace(f, viewmat=measured[f.rank]) for f in plan.frames)
    return dataclasses.replace(plan, frames=frames)


def checksums(folder: Folder) -> dict[str, str]:
    """SHA-256 of every file of the capture by its path, but for the index and what differs from run to run."""
    left_out = {CHECKSUMS, COSTS, INDEX, LEDGER, PLAN}
    files = sorted(path for path in folder.root.rglob("*") if path.is_file())
    names = {folder.relative(path): path for path in files if SECOND not in path.relative_to(folder.root).parts[:1]}
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in names.items() if name not in left_out}


def _annotations(name: str, plan: Plan, folder: Folder) -> None:
    from importlib import import_module

    for path, text in import_module(f"synth.export.{name}").files(plan, folder).items():
        write_text(folder.root / path, text)
