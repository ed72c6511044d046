"""Which activity the capture's truth knows at each anchor (docs/formats.md, `truth/activity`)."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .clip import Clip
from .container import Floats, ModelFileError

LABELS = ("static", "intermittent", "persistent", "appearance-only", "unseen")
UNKNOWN = -1
FRAMES_READ = 12  # spread over the clip: every frame would tell the same again
BEHIND_M = 1.0  # an anchor farther behind what the frame shows is hidden there

Labels = npt.NDArray[np.int32]


def label_units(
    clip: Clip,
    count: int,
    folder: Path,
    positions_at: Callable[[int], Floats],
    read_labels: Callable[[Path], npt.NDArray[np.uint8]],
) -> Labels:
    """The label [count] that most frames show at each unit (an anchor, a Gaussian of a track), -1 where none shows it.

    `positions_at(frame)` gives the units [count, 3] in world metres, NaN for those that are not there then,
    `read_labels(path)` the picture [H, W], first row at the top. Where the frame's depth is known, hidden units are
    left out.

    Raises:
        ModelFileError: the capture holds no activity labels.
    """
    votes = np.zeros((count, len(LABELS)), np.int32)
    names = [Path(image).stem for image in clip.images]
    known = [frame for frame, name in enumerate(names) if (folder / "truth" / "activity" / f"{name}.png").is_file()]
    if not known:
        raise ModelFileError(f"{folder} holds no activity labels; they are an optional truth of the capture.")
    for frame in {known[round(place)] for place in np.linspace(0, len(known) - 1, min(FRAMES_READ, len(known)))}:
        labels = read_labels(folder / "truth" / "activity" / f"{names[frame]}.png")
        view = positions_at(frame) @ clip.viewmats[frame, :3, :3].T + clip.viewmats[frame, :3, 3]
        depth = view[:, 2]
        pixels = (view / np.maximum(depth, 1e-6)[:, None]) @ clip.camera.K.T
        height, width = labels.shape
        inside = (depth > 0) & (pixels[:, :2] >= 0).all(axis=1) & (pixels[:, 0] < width) & (pixels[:, 1] < height)
        column, row = (np.where(inside, pixels[:, axis], 0).astype(np.intp) for axis in (0, 1))
        seen_depth = _depth(folder / "truth" / f"{names[frame]}.npz", labels.shape)
        if seen_depth is not None:
            inside &= depth < seen_depth[row, column] + BEHIND_M
        label = labels[row, column]
        inside &= label < len(LABELS)
        votes[np.flatnonzero(inside), label[inside]] += 1
    return np.where(votes.any(axis=1), votes.argmax(axis=1), UNKNOWN).astype(np.int32)


def _depth(path: Path, shape: tuple[int, ...]) -> Floats | None:
    """The frame's depth [H, W], where it is there and whole."""
    try:
        with np.load(path, allow_pickle=False) as truth:
            depth = truth["depth_z"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    return depth if depth.shape == shape and depth.dtype == np.float32 else None
