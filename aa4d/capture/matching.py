"""Pairs of frames to compare, and their verified matches.

A video's frames overlap with those around them: each is matched with the `window` frames after it and with those at
twice, four times, ... that distance. A drone comes back to what it has seen: `keyframes` frames, spread over the clip,
are matched each with each, which closes loops without a vocabulary tree to download.
"""

from __future__ import annotations

import shutil
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap

from aa4d.capture.apart import apart
from aa4d.capture.clip import Clip
from aa4d.capture.colmap import in_blocks, opened
from aa4d.capture.features import Features
from aa4d.capture.settings import Reconstruction
from aa4d.capture.workspace import Progress, Step, StepResult

PAIRS_A_THREAD = 10  # size of a block, which is stored whole: what a stopped run keeps


@dataclass(frozen=True)
class Matches(StepResult):
    pairs: int  # compared
    verified: int  # a geometry holds for so many
    geometry: dict[str, int]  # how many of them are of each kind, by COLMAP's names
    gaps: tuple[int, ...]  # frames that have nothing in common with the next

    @property
    def database(self) -> Path:
        return self.folder / "database.db"


def matches_step(clip: Clip, features: Features, settings: Reconstruction, threads: int, seed: int) -> Step[Matches]:
    return Step(
        "matches",
        [settings.window, settings.keyframes, seed],
        lambda *place: match(clip, features.database, settings, threads, seed, *place),
        Matches,
    )


def pairs(frames: int, window: int, keyframes: int) -> list[tuple[int, int]]:
    """Sorted pairs i < j of frame ranks."""
    distances = set(range(1, window + 1))
    distance = 2 * window
    while distance < frames:
        distances.add(distance)
        distance *= 2
    found = {(i, i + d) for d in distances for i in range(frames - d)}
    keys = sorted(set(np.linspace(0, frames - 1, min(keyframes, frames)).round().astype(int).tolist()))
    found |= {(a, b) for n, a in enumerate(keys) for b in keys[n + 1 :]}
    return sorted(found)


def match(
    clip: Clip, features: Path, settings: Reconstruction, threads: int, seed: int, folder: Path, progress: Progress
) -> Matches:
    """Add matches to a copy of the features' database in `folder`; pairs that it holds already are not repeated."""
    database = folder / "database.db"
    if not database.exists():
        unfinished = folder / "copying.db"
        shutil.copyfile(features, unfinished)
        unfinished.replace(database)
    wanted = pairs(len(clip.frames), settings.window, settings.keyframes)
    names = [frame.file for frame in clip.frames]
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = threads
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    # Tells a turning camera from a flat scene.
    verification.compute_relative_pose = True
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = folder / "pairs.txt"
    with apart(folder) as run:
        for done, block in in_blocks(wanted, PAIRS_A_THREAD * threads):
            lines = "".join(f"{names[i]} {names[j]}\n" for i, j in block)
            Path(pairing.match_list_path).write_text(lines, encoding="utf-8")
            device = pycolmap.Device.cpu
            run(pycolmap.match_image_pairs, database, matching, pairing, verification, device=device)
            progress(done + len(block), len(wanted))
    kinds, gaps = _verified(database, names)
    return Matches(folder, len(wanted), sum(kinds.values()), kinds, gaps)


def _verified(database: Path, names: list[str]) -> tuple[dict[str, int], tuple[int, ...]]:
    """Pairs that hold by their kind of geometry, and the frames that have nothing in common with the next."""
    with opened(database) as stored:
        rank_of = {image.image_id: names.index(image.name) for image in stored.read_all_images()}
        ids, geometries = stored.read_two_view_geometries()
    kinds: Counter[str] = Counter()
    joined: set[int] = set()
    for pair, geometry in zip(ids, geometries, strict=True):
        if len(geometry.inlier_matches) == 0:
            continue
        kinds[pycolmap.TwoViewGeometryConfiguration(geometry.config).name] += 1
        a, b = sorted(rank_of[i] for i in pycolmap.pair_id_to_image_pair(pair))
        joined.update(range(a, b))
    return dict(kinds), tuple(i for i in range(len(names) - 1) if i not in joined)
