"""The frames go through a real video encoder and back, as the drone's recording does.

What the sensor gave is kept in uncompressed/, the video itself in video.mp4.
"""

from dataclasses import dataclass
from typing import Any, Literal

from synth.checking import key

STAGE = "encode"
COST = "encoding and decoding all frames once, at the end"
TRUTH = "none"


@dataclass(frozen=True, kw_only=True)
class Settings:
    codec: Literal["H264", "H265", "AV1"] = key("the encoder", default="H264")
    bitrate_kbps: int = key("of the video", unit="kbit/s", range=(10, 1_000_000), default=4000)
    keyframe_every: int = key("frames from one key frame to the next", range=(1, 1000), default=30)


def encode(settings: Settings, plan: Any, folder: Any) -> None:
    from synth.blender.video import through_video

    through_video(
        [folder.developed(frame) for frame in plan.frames],
        [folder.image(frame) for frame in plan.frames],
        folder.root / "video.mp4",
        plan.scene.time.fps,
        (settings.codec, settings.bitrate_kbps, settings.keyframe_every),
    )
