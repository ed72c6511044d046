"""Pictures as an MP4 that every player opens."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.video.reformatter import ColorRange, Colorspace
from numpy.typing import NDArray

from aa4d.files import whole_file

QUALITY = "18"  # x264's constant rate factor: visually lossless
TICKS = 90_000  # a second, of a video whose steps are not even
BT709 = 1  # of MPEG's tables of primaries, transfer curves and matrices


def write_video(
    path: Path, pictures: Iterable[NDArray[np.uint8]], fps: float, seconds: NDArray[np.float64] | None = None
) -> None:
    """H.264, 4:2:0, BT.709. A picture of odd width or height is extended by its last column or row.

    Args:
        pictures: [H, W, 3] sRGB, all of one size.
        fps: frames per second, on the mean.
        seconds: [pictures] when each is shown, rising from 0; None: at even steps.
    """
    with whole_file(path) as temporary, av.open(str(temporary), "w", format="mp4") as container:
        stream = None
        for rank, picture in enumerate(pictures):
            # 4:2:0 halves the resolution of colour, so sides must be even.
            height, width = picture.shape[:2]
            even = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
            if stream is None:
                stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000))
                stream.width, stream.height, stream.pix_fmt = even.shape[1], even.shape[0], "yuv420p"
                stream.options = {"crf": QUALITY}
                context = stream.codec_context
                if seconds is not None:
                    context.time_base = Fraction(1, TICKS)
                context.colorspace, context.color_range = Colorspace.ITU709, ColorRange.MPEG
                context.color_primaries, context.color_trc = BT709, BT709
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
            converted = frame.reformat(format="yuv420p", dst_colorspace=Colorspace.ITU709)
            if seconds is not None:
                converted.pts, converted.time_base = round(float(seconds[rank]) * TICKS), Fraction(1, TICKS)
            container.mux(stream.encode(converted))
        if stream is not None:
            container.mux(stream.encode())
