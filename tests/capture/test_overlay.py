"""Text that is burned into a film is found, and nothing where there is none."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from aa4d.capture.overlay import overlay_note
from tests.capture import aerial

Pictures = list[NDArray[np.uint8]]


def note_on(folder: Path, pictures: Pictures) -> str | None:
    return overlay_note(sorted(aerial.write(folder, pictures).glob("*.png")))


def with_text(pictures: Pictures) -> Pictures:
    shown = [picture.copy() for picture in pictures]
    for rank, picture in enumerate(shown):
        white = (255, 255, 255)
        cv2.putText(picture, "REC", (8, 225), cv2.FONT_HERSHEY_SIMPLEX, 0.6, white, 2, cv2.LINE_AA)
        cv2.putText(picture, f"{rank:03}", (270, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, white, 1, cv2.LINE_AA)
    return shown


def test_text_that_stands_still_in_the_picture_is_found(tmp_path: Path) -> None:
    flight = aerial.pictures(aerial.arc())
    assert note_on(tmp_path / "plain", flight) is None
    said = note_on(tmp_path / "text", with_text(flight))
    assert said is not None
    assert said.startswith("something stands still in the picture (")
    assert "bottom left" in said


@pytest.mark.parametrize("count", [7, 9])
def test_a_camera_that_hovers_or_too_few_frames_say_nothing(tmp_path: Path, count: int) -> None:
    flight = aerial.pictures(aerial.arc())
    pictures = [flight[0]] * 9 if count == 9 else with_text(flight)[:count]
    assert note_on(tmp_path / "frames", pictures) is None
