"""Small videos, written with PyAV."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import cast

import av
import numpy as np
from numpy.typing import NDArray

TICKS = 1000  # a second


def write_video(
    path: Path,
    images: list[NDArray[np.uint8]],
    times_s: list[float],
    codec: str = "mpeg4",
    pixel_aspect: Fraction | None = None,
) -> Path:
    """A video of high quality (MPEG-4 part 2 by default) whose frames have those presentation times."""
    with av.open(str(path), "w") as container:
        stream = cast(av.VideoStream, container.add_stream(codec, rate=25))
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        if pixel_aspect is not None:
            stream.codec_context.sample_aspect_ratio = pixel_aspect
        stream.time_base = stream.codec_context.time_base = Fraction(1, TICKS)
        stream.bit_rate = 8_000_000
        stream.codec_context.gop_size = 4 if codec == "mpeg4" else 250
        for image, time_s in zip(images, times_s, strict=True):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts = round(time_s * TICKS)
            frame.time_base = Fraction(1, TICKS)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def turn_clockwise(path: Path) -> None:
    """Set the track's display matrix, as a telephone that is held upright does."""
    data = bytearray(path.read_bytes())
    matrix = data.index(b"tkhd") + 4 + 40
    values = (0, 1 << 16, 0, -(1 << 16), 0, 0, 0, 0, 1 << 30)
    data[matrix : matrix + 36] = b"".join(v.to_bytes(4, "big", signed=True) for v in values)
    path.write_bytes(data)


def cut_short(path: Path, share: float) -> None:
    """A file that ends within its pictures, its index kept: as copying breaks off. Needs the index in front."""
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])


def index_in_front(path: Path) -> None:
    with av.open(str(path)) as source, av.open(str(path) + ".tmp.mp4", "w", options={"movflags": "faststart"}) as out:
        into = out.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(source.streams.video[0]):
            if packet.dts is not None:
                packet.stream = into
                out.mux(packet)
    Path(str(path) + ".tmp.mp4").replace(path)
