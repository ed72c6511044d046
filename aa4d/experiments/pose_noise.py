"""How much of a pose error does `--refine-poses` take out, and what does it give in PSNR?

    python -m aa4d.experiments.pose_noise CAPTURE --out DIR

The training cameras of a capture with true poses are moved at random: by an angle about a random axis, and by a share
of the viewing distance in a random direction (both the root mean square over the frames). Each noisy capture is
trained twice, with the poses as given and with `--refine-poses`. Held-out frames are never trained on, and no pose is
fitted to them: the learned cameras are aligned with the true ones by one similarity for all, and the held-out frames
are rendered from their true poses in the learned world.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional, arg

from aa4d import __version__
from aa4d.capture.orientation import viewing_distance
from aa4d.capture.pose_error import PoseError, in_other_world, inverse, pose_error
from aa4d.capture.reader import Capture, read_capture, read_image
from aa4d.experiments.against import plot_against
from aa4d.experiments.axis import Knob
from aa4d.experiments.kinds.evaluate import Row
from aa4d.experiments.kinds.train import fit, iterations_of
from aa4d.experiments.program import rows_of_tasks, run_as_program
from aa4d.graph.call import Call
from aa4d.graph.kinds import Kind
from aa4d.graph.task import Task, location
from aa4d.identity import Identity, digest_of
from aa4d.methods.adaanchor4d.settings import PRESETS, AdaAnchor4DSettings
from aa4d.methods.settings import with_iterations
from aa4d.training.run_folder import what_counts

NOISE = "noise, ° and % of the viewing distance"
Floats = NDArray[np.float64]


def noisy(capture: Capture, angle_deg: float, share: float, seed: int) -> Capture:
    """The capture with its training cameras moved; held-out ones stay."""
    generator = np.random.default_rng(seed)
    train = capture.of_split("train")
    viewmats = np.array([capture.frames[i].viewmat for i in train])
    distance = viewing_distance(viewmats, capture.points)
    frames = list(capture.frames)
    for i, viewmat in zip(train, viewmats, strict=True):
        # Each of the three axes has a third of the variance.
        turn = np.radians(angle_deg) / np.sqrt(3) * generator.normal(size=3)
        shift = share * distance / np.sqrt(3) * generator.normal(size=3)
        frames[i] = replace(frames[i], viewmat=_moved(viewmat, turn, shift))
    moved = Identity(
        "capture",
        digest_of([frame.viewmat.tolist() for frame in frames]),
        {"capture": capture.identity.digest()},
    )
    return replace(capture, frames=tuple(frames), identity=moved)


def _moved(viewmat: Floats, turn: Floats, shift: Floats) -> Floats:
    """The camera turned about its own centre and shifted, along its own axes."""
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_rotvec(turn).as_matrix()
    moved = np.eye(4)
    moved[:3, :3] = rotation @ viewmat[:3, :3]
    moved[:3, 3] = rotation @ viewmat[:3, 3] + shift
    return moved


@dataclass(frozen=True)
class Noise:
    capture: str  # identity of the one with true poses
    level: float  # degrees, and per cent of the viewing distance
    seed: int  # of the noise
    counts: dict[str, Any]  # of the settings: those that tell this run from others
    training: AdaAnchor4DSettings = location()
    path: Path = location()


def measure(call: Call) -> dict[str, Any]:
    """Train on noisy poses, compare with the true ones. Raises what training raises."""
    from aa4d.methods.model_file import load_model

    noise: Noise = call.task.settings
    truth = read_capture(noise.path)
    given = noisy(truth, noise.level, noise.level / 100, noise.seed)
    fit(call, given, noise.training)
    loaded = load_model(call.folder / "model.safetensors")
    ranks = truth.of_split("train")
    true = np.array([truth.frames[i].viewmat for i in ranks])
    distance = viewing_distance(true, truth.points)
    before = pose_error(np.array([given.frames[i].viewmat for i in ranks]), true, distance)
    after = pose_error(np.array([loaded.frames[i].viewmat for i in ranks]), true, distance)
    return {
        "noise": noise.level,
        "refined": noise.training.refine_poses,
        "angle_before_deg": before.rotation_deg,
        "angle_after_deg": after.rotation_deg,
        "shift_before": before.trajectory_m / distance,
        "shift_after": after.trajectory_m / distance,
        "psnr": held_out_psnr(truth, loaded, after),
        "seconds": loaded.training_seconds,
    }


KIND = Kind(measure, version=__version__)


def held_out_psnr(truth: Capture, loaded: Any, error: PoseError) -> float:
    """Mean over the held-out frames, seen from their true poses in the model's world."""
    import torch

    from aa4d.evaluation.image_metrics import psnr
    from aa4d.methods.rendering import render

    c = truth.camera
    found = []
    for index in truth.of_split("test"):
        frame = truth.frames[index]
        viewmat = in_other_world(frame.viewmat[None], inverse(error.to_truth))[0]
        camera = loaded.frame.camera(viewmat, c.K, c.width, c.height)
        with torch.no_grad():
            color = render(loaded.model, frame.t, camera, torch.tensor(loaded.background)).rendering.color
        target = torch.from_numpy(read_image(truth, frame)).float() / 255
        found.append(psnr(color.clamp(0, 1), target))
    return float(np.mean(found))


def main(
    capture: Annotated[Positional[Path], arg(help="Capture whose poses are true.")],
    out: Annotated[Path, arg(help="Folder for the runs and table.json.")],
    levels: Annotated[tuple[float, ...], arg(help="Degrees, and as many per cent of the viewing distance.")] = (
        0.0,
        0.1,
        0.5,
        1.0,
        2.0,
    ),
    iterations: tuple[int, int] = (800, 3000),
    seed: int = 0,
    jobs: Annotated[int, arg(help="Trainings at a time.")] = 1,
) -> None:
    identity = read_capture(capture).identity.digest()
    base = with_iterations(replace(PRESETS["quick"], seed=seed), *iterations)
    tasks = []
    for level in levels:
        for refine in (False, True):
            config = replace(base, refine_poses=refine)
            noise = Noise(identity, level, seed + 1, what_counts(config), config, capture.resolve())
            name = f"{level:g} {'refined' if refine else 'given'}"
            tasks.append(Task("pose-noise", name, noise, units=iterations_of(config)))
    rows = rows_of_tasks(tasks, out, jobs)
    drawn: list[Row] = [
        {
            "capture": capture.name,
            "variant": "refined" if row["refined"] else "as given",
            "at": row["noise"],
            "psnr": row["psnr"],
        }
        for row in rows
    ]
    plot_against(Knob(NOISE), "Pose noise", drawn, out / "plot.png")
    print("noise  refined  angle_deg before after  shift_% before after  psnr  seconds")
    for row in rows:
        print(
            f"{row['noise']:g} {row['refined']!s:5} {row['angle_before_deg']:.3f} {row['angle_after_deg']:.3f}  "
            f"{100 * row['shift_before']:.3f} {100 * row['shift_after']:.3f}  {row['psnr']:.2f}  {row['seconds']:.0f}"
        )


if __name__ == "__main__":
    run_as_program(main)
