"""SIFT features of every frame (COLMAP, on the CPU), none where something moves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pycolmap

from aa4d.capture.apart import apart
from aa4d.capture.clip import Clip
from aa4d.capture.colmap import in_blocks, opened
from aa4d.capture.movers import Masks
from aa4d.capture.overlay import Overlay
from aa4d.capture.settings import Reconstruction
from aa4d.capture.workspace import Progress, Step, StepResult

USUAL_FOCAL = 0.8  # fraction of the longest side: between the wide lens of most drones and the next longer one
FRAMES_A_THREAD = 2  # size of a block


@dataclass(frozen=True)
class Features(StepResult):
    features: tuple[int, ...]  # number of each frame's

    @property
    def database(self) -> Path:
        return self.folder / "database.db"


def stated_focal_px(fov_deg: float | None, share: float | None, clip: Clip) -> float | None:
    """The focal length of the clip's frames, as the user or else EXIF says; None where neither does."""
    if fov_deg is not None:
        return 0.5 * clip.width / math.tan(math.radians(fov_deg) / 2)
    return None if share is None else share * max(clip.width, clip.height)


def features_step(
    clip: Clip,
    masks: Masks | None,
    settings: Reconstruction,
    focal_px: float | None,
    threads: int,
    overlay: Overlay | None = None,
) -> Step[Features]:
    return Step(
        "features",
        [settings.features, settings.longest_px, settings.camera_model, focal_px],
        lambda folder, progress: extract(clip, masks, settings, focal_px, threads, folder, progress, overlay),
        Features,
    )


def extract(
    clip: Clip,
    masks: Masks | None,
    settings: Reconstruction,
    focal_px: float | None,
    threads: int,
    folder: Path,
    progress: Progress,
    overlay: Overlay | None = None,
) -> Features:
    """Write `database.db` into `folder`; frames that it holds already are left as they are.

    All frames are of one camera. Where nothing says its focal length, it is guessed, as drones have it.
    """
    database = folder / "database.db"
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = threads
    options.max_image_size = settings.longest_px
    options.sift.max_num_features = settings.features
    reader: dict[str, Any] = {"camera_model": settings.camera_model, "default_focal_length_factor": USUAL_FOCAL}
    if focal_px is not None:
        camera = pycolmap.Camera.create_from_model_name(1, settings.camera_model, focal_px, clip.width, clip.height)
        reader["camera_params"] = camera.params_to_string()
    if masks is not None:
        reader["mask_path"] = masks.folder
    if overlay is not None and overlay.share:
        reader["camera_mask_path"] = overlay.mask
    names = [frame.file for frame in clip.frames]
    with apart(folder) as run:
        for done, block in in_blocks(names, FRAMES_A_THREAD * threads):
            # A block is stored whole: what a stopped run keeps, and what the progress counts.
            run(_extract_block, database, clip.folder, block, reader, options)
            with opened(database) as stored:
                reader["existing_camera_id"] = stored.read_all_cameras()[0].camera_id
            progress(done + len(block), len(names))
    with opened(database) as stored:
        found = {image.name: stored.num_keypoints_for_image(image.image_id) for image in stored.read_all_images()}
    return Features(folder, tuple(found.get(name, 0) for name in names))


def _extract_block(
    database: Path, images: Path, names: list[str], reader: dict[str, Any], options: pycolmap.FeatureExtractionOptions
) -> None:
    """`reader` has what is not the default: an ImageReaderOptions that was pickled takes "." for an absent path."""
    pycolmap.extract_features(
        database,
        images,
        image_names=names,
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=pycolmap.ImageReaderOptions(**reader),
        extraction_options=options,
        device=pycolmap.Device.cpu,
    )
