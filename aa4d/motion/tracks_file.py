"""Tracks on disk: `tracks.npz` of a run folder (docs/formats.md)."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np

from aa4d.errors import InputError
from aa4d.files import write_bytes
from aa4d.motion.spline import FEWEST_CONTROLS
from aa4d.motion.tracks import Tracks


def tracks_path(out: Path) -> Path:
    return out / "tracks.npz"


def movers_path(out: Path) -> Path:
    """The first look, on a static stage that saw the movers: what the clean stage leaves out."""
    return out / "movers.npz"


def save_tracks(path: Path, tracks: Tracks) -> None:
    content = BytesIO()
    np.savez_compressed(
        content,
        names=np.array(tracks.names, dtype=np.str_),
        control=tracks.control,
        shown=tracks.shown,
        up=tracks.up,
        labels=tracks.labels,
        moving=np.packbits(tracks.moving, axis=-1),
    )
    write_bytes(path, content.getvalue())


def load_tracks(path: Path) -> Tracks:
    """Raises InputError for a file that is missing, damaged or not of tracks."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in file.files}
        labels = arrays["labels"].astype(np.uint16)
        groups = len(arrays["names"])
        tracks = Tracks(
            names=tuple(str(name) for name in arrays["names"]),
            control=arrays["control"].astype(np.float64).reshape(groups, arrays["control"].shape[1], 4),
            shown=arrays["shown"].astype(np.float64).reshape(groups, 4),
            up=arrays["up"].astype(np.float64).reshape(3),
            labels=labels,
            moving=np.unpackbits(arrays["moving"], axis=-1, count=labels.shape[-1]).astype(bool).reshape(labels.shape),
        )
    except FileNotFoundError:
        raise InputError(f"{path}: the run's tracks are missing; delete the run and train again") from None
    except Exception as error:  # zipfile, zlib and numpy each raise their own kind for a damaged file
        raise InputError(f"{path}: tracks cannot be read ({error}); delete the run and train again") from None
    sane = all(np.isfinite(a).all() for a in (tracks.control, tracks.shown, tracks.up))
    if not sane or (groups and tracks.control.shape[1] < FEWEST_CONTROLS) or labels.max(initial=0) > groups:
        raise InputError(f"{path}: tracks do not fit together; delete the run and train again")
    return tracks
