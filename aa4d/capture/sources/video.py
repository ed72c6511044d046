"""A video file, decoded by FFmpeg's libraries (PyAV)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.capture.clip import Picture
from aa4d.capture.gnss import Track, read_subtitles
from aa4d.capture.settings import Selection
from aa4d.capture.sources import Source
from aa4d.errors import InputError

EXTENSIONS = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".webm", ".mts", ".ts")

MOST_STRETCHED = 4  # times: beyond, what a file says of its pixels' shape is not believed
EARLY_STEPS = 3  # frames by which the last may lie before the end that the container states


def recognises(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() in EXTENSIONS


def open_source(path: Path, selection: Selection, annotations: Path | None) -> Source:
    """Frames with their presentation times; a DJI drone's subtitles of the same name give positions."""
    if annotations is not None:
        raise InputError(f"{annotations}: boxes go by frame number, and a video has none; extract its frames first")
    notes = selection.ignored_fps("a video")
    index = cache(partial(_index, path, notes))
    subtitles = next((p for p in (path.with_suffix(".SRT"), path.with_suffix(".srt")) if p.is_file()), None)
    track = None if subtitles is None else read_subtitles(subtitles)
    if subtitles is not None and track is None:
        notes.append(f"{subtitles.name} holds no usable position and is not used")
    files = (path,) if subtitles is None else (path, subtitles)

    @cache
    def times_s() -> list[float]:
        shown = index().times_s
        if subtitles is not None and track is not None and not any(track.at(time_s) for time_s in shown):
            notes.append(
                f"the positions in {subtitles.name} are of {track.time_s[0]:.1f} s to {track.time_s[-1]:.1f} s, the "
                f"video ends at {shown[-1]:.1f} s: they are not used; is the file this video's?"
            )
        return shown

    return Source(
        "video",
        _frames(path, selection.start_s, track, index, notes),
        times_s,
        files,
        notes,
        again=lambda start_s: _frames(path, start_s, track, index, []),
    )


@dataclass(frozen=True)
class Index:
    """Facts that a video states about its frames before one is decoded."""

    first_s: float  # when the first is shown, by the stream's own clock
    times_s: list[float]  # from the first
    step_s: float  # median
    end_s: float  # by the container's word, where it has one
    pixel_aspect: Fraction  # width of a stored pixel over its height


def _index(path: Path, notes: list[str]) -> Index:
    """Read the file through once, nothing decoded.

    Raises:
        InputError: the file is no video.
    """
    import av

    if path.stat().st_size == 0:
        raise InputError(f"{path}: is empty (0 bytes); copy it again")
    times: list[float] = []
    duration, pixel_aspect = 0.0, Fraction(1)
    try:
        with av.open(_address(path)) as container:
            if not container.streams.video:
                raise InputError(f"{path}: holds no video stream; give the video itself")
            stream = container.streams.video[0]
            if stream.duration is not None and stream.time_base is not None:
                duration = float(stream.duration * stream.time_base)
            elif container.duration is not None:
                duration = container.duration / av.time_base
            stated = stream.sample_aspect_ratio
            if stated and 1 / MOST_STRETCHED <= stated <= MOST_STRETCHED:
                pixel_aspect = Fraction(stated)
            for packet in container.demux(stream):
                ticks = packet.dts if packet.pts is None else packet.pts
                if ticks is not None and not packet.is_discard:
                    times.append(float(ticks * packet.time_base))
    except (av.FFmpegError, OSError) as error:
        if not times:
            raise InputError(
                f"{path}: cannot be opened as a video ({error}); an MP4 whose recording broke off has lost its index "
                "and needs repair (untrunc), any other should be copied again"
            ) from None
    if not times:
        raise InputError(f"{path}: holds no frame; copy it again")
    shown = np.sort(times) - min(times)
    steps = np.diff(shown) if len(shown) > 1 else np.array([duration])
    if steps.max() > 1.5 * np.median(steps):
        notes.append("variable frame rate: every frame keeps its own presentation time")
    if pixel_aspect != 1:
        notes.append(f"pixels are not square ({pixel_aspect}): pictures are stretched, as players show them")
    return Index(min(times), shown.tolist(), float(np.median(steps)), max(duration, float(shown[-1])), pixel_aspect)


def _address(path: Path) -> str:
    """With its folder: FFmpeg takes what stands before a colon for a protocol."""
    return str(path.absolute())


def _frames(
    path: Path, start_s: float, track: Track | None, index: Callable[[], Index], notes: list[str]
) -> Iterator[Picture]:
    """Decode in presentation order; where the data end early, what was decoded is used and a note says so."""
    import av

    first, end, last = index().first_s, index().end_s, 0.0
    try:
        with av.open(_address(path)) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            for frame in _decoded_from(start_s + first, container, stream):
                last = float(frame.pts * (frame.time_base or 0)) - first
                position = None if track is None else track.at(last)
                yield Picture(f"{last:.3f} s", last, None, _loader(frame, index().pixel_aspect), position=position)
    except av.FFmpegError:
        pass  # what follows says so
    if last + EARLY_STEPS * index().step_s < end:
        notes.append(f"the video ends early, at {last:.2f} s of {end:.2f} s: the frames until then are used")


def _decoded_from(start_s: float, container: Any, stream: Any) -> Iterator[Any]:
    """Whole frames, from the key frame before `start_s` or, where the file cannot be entered there, an earlier one."""

    def decoded() -> Iterator[Any]:
        return (f for f in container.decode(stream) if f.pts is not None and not f.is_corrupt)

    container.seek(int(start_s / stream.time_base), stream=stream)
    frames = decoded()
    head = next(frames, None)
    if head is not None and head.pts * head.time_base <= start_s + 1e-6:
        yield head
    else:
        container.seek(0)
        frames = decoded()
    yield from frames


def _loader(frame: Any, pixel_aspect: Fraction) -> Callable[[], NDArray[np.uint8]]:
    def load() -> NDArray[np.uint8]:
        pixels = squared(frame.to_ndarray(format="rgb24"), pixel_aspect)
        # The display matrix: degrees counter-clockwise, in steps of 90 from every camera there is.
        return np.ascontiguousarray(np.rot90(pixels, k=round(frame.rotation / 90)))

    return load


def squared(pixels: NDArray[np.uint8], pixel_aspect: Fraction) -> NDArray[np.uint8]:
    """[H, W, 3] with square pixels: the side that is too short is stretched, so that nothing is lost."""
    if pixel_aspect == 1:
        return pixels
    height, width = pixels.shape[:2]
    size = (round(width * pixel_aspect), height) if pixel_aspect > 1 else (width, round(height / pixel_aspect))
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_CUBIC), np.uint8)
