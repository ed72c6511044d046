"""Footage as people have it: each ends in a usable capture with a note, or in one sentence that says what to do."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from aa4d.capture.clip import Clip
from aa4d.capture.make import make_capture
from aa4d.capture.reader import read_capture
from aa4d.capture.selection import make_clip
from aa4d.capture.settings import PRESETS, CaptureSettings, Selection
from aa4d.capture.sources import open_source
from aa4d.errors import InputError
from tests.capture import aerial
from tests.capture.videos import cut_short, index_in_front, turn_clockwise, write_video

QUICK = replace(PRESETS["fast"], features=800, longest_px=320, window=3, keyframes=4)
SETTINGS = CaptureSettings("test", QUICK, Selection(source_fps=10.0), movers="off", threads=1)
IMAGES = aerial.pictures(aerial.arc())


def silent(*_: Any) -> Callable[..., None]:
    return lambda *_: None


def clip_of(path: Path, folder: Path, selection: Selection | None = None) -> Clip:
    folder.mkdir()
    selection = selection or Selection(source_fps=10.0 if path.is_dir() else None)
    source = open_source(path, selection, None)
    return make_clip(source.pictures, source.times_s(), selection, source.notes, folder, lambda *_: None)


def pixels(clip: Clip, rank: int) -> np.ndarray:
    with Image.open(clip.folder / clip.frames[rank].file) as image:
        return np.asarray(image.convert("RGB"), np.float64)


def test_a_video_keeps_its_presentation_times(tmp_path: Path) -> None:
    video = write_video(tmp_path / "flight.mp4", IMAGES, [i / 10 for i in range(9)])
    clip = clip_of(video, tmp_path / "clip")
    assert [f.time_s for f in clip.frames] == pytest.approx([i / 10 for i in range(9)])
    assert np.abs(pixels(clip, 5) - IMAGES[5]).mean() < 12
    assert clip.notes == ()


def test_rate_and_range_of_a_video(tmp_path: Path) -> None:
    images = [IMAGES[i // 3] for i in range(27)]
    video = write_video(tmp_path / "flight.mp4", images, [i / 30 for i in range(27)])
    selection = Selection(rate=10, start_s=0.2, end_s=0.65)
    clip = clip_of(video, tmp_path / "clip", selection)
    assert len(clip.frames) == 5
    assert all(0.2 <= f.time_s <= 0.65 for f in clip.frames)
    assert np.abs(pixels(clip, 2) - IMAGES[round(clip.frames[2].time_s * 10 - 0.5)]).mean() < 12


@pytest.mark.parametrize("ending", ["mp4", "mov", "mkv", "ts"])
def test_every_container_can_be_entered_in_the_middle(tmp_path: Path, ending: str) -> None:
    """One key frame, frames out of order. An MPEG stream has no index: a jump can land where nothing can be decoded."""
    video = write_video(tmp_path / f"flight.{ending}", IMAGES, [i / 25 for i in range(9)], codec="libx264")
    selection = Selection(start_s=0.199, rate=1000)
    clip = clip_of(video, tmp_path / "clip", selection)
    assert [f.time_s for f in clip.frames] == pytest.approx([i / 25 for i in range(5, 9)], abs=2e-3)
    assert np.abs(pixels(clip, 0) - IMAGES[5]).mean() < 12
    assert clip.notes == ()


@pytest.mark.parametrize(("aspect", "size"), [(Fraction(4, 3), (427, 240)), (Fraction(8, 9), (320, 270))])
def test_pixels_that_are_not_square_are_made_so(tmp_path: Path, aspect: Fraction, size: tuple[int, int]) -> None:
    video = write_video(tmp_path / "tape.mp4", IMAGES, [i / 10 for i in range(9)], pixel_aspect=aspect)
    clip = clip_of(video, tmp_path / "clip")
    assert (clip.width, clip.height) == clip.source_size == size
    expected = np.asarray(Image.fromarray(IMAGES[5]).resize(size), np.float64)
    assert np.abs(pixels(clip, 5) - expected).mean() < 12
    assert clip.notes == (f"pixels are not square ({aspect}): pictures are stretched, as players show them",)


def test_a_colon_in_a_relative_name_is_no_protocol(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_video(tmp_path / "flight.mp4", IMAGES, [i / 10 for i in range(9)]).rename("file:12:30.mp4")
    assert len(clip_of(Path("file:12:30.mp4"), tmp_path / "clip").frames) == 9


def test_a_variable_frame_rate_is_kept_and_told(tmp_path: Path) -> None:
    times = [0, 0.04, 0.08, 0.3, 0.34, 0.38, 0.6, 0.64, 0.9]
    clip = clip_of(write_video(tmp_path / "phone.mp4", IMAGES, times), tmp_path / "clip", Selection(rate=1000))
    assert [f.time_s for f in clip.frames] == pytest.approx(times, abs=0.002)
    assert any("variable frame rate" in note for note in clip.notes)


def test_a_video_that_ends_within_a_frame_is_used_until_there(tmp_path: Path) -> None:
    video = write_video(tmp_path / "broken.mp4", IMAGES, [i / 10 for i in range(9)])
    index_in_front(video)
    cut_short(video, 0.7)
    clip = clip_of(video, tmp_path / "clip")
    assert 3 <= len(clip.frames) < 9
    assert any("ends early" in note for note in clip.notes)


def test_an_empty_video_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.mp4").touch()
    with pytest.raises(InputError, match=r"empty\.mp4: is empty \(0 bytes\); copy it again"):
        clip_of(tmp_path / "empty.mp4", tmp_path / "clip")


@pytest.mark.parametrize(("count", "wanted"), [(15, 8), (15, 15), (9, 150), (14, 3)])
@pytest.mark.parametrize("kind", ["video", "folder"])
def test_as_many_frames_as_asked_for_evenly_spread(tmp_path: Path, count: int, wanted: int, kind: str) -> None:
    images = aerial.pictures(aerial.arc(count))
    source = tmp_path / "flight.mp4"
    if kind == "video":
        write_video(source, images, [i / 30 for i in range(count)])
    else:
        source = aerial.write(tmp_path / "frames", images)
    clip = clip_of(source, tmp_path / "clip", Selection(max_frames=wanted))
    ranks = [round(f.time_s * 30) for f in clip.frames]
    assert len(ranks) == min(wanted, count)
    assert max(np.diff(ranks)) <= 2 * count / min(wanted, count)


def test_a_range_behind_the_end_or_without_a_frame(tmp_path: Path) -> None:
    source = aerial.write(tmp_path / "frames", IMAGES)
    for selection in (Selection(source_fps=10, start_s=5), Selection(source_fps=10, start_s=0.11, end_s=0.19)):
        with pytest.raises(InputError, match=r"no frame lies between .* from 0\.00 s to 0\.80 s; choose a range"):
            make_clip(*_opened(source, selection), selection, [], tmp_path, lambda *_: None)
    # An end that lies behind the input's takes nothing away.
    clip = clip_of(source, tmp_path / "clip", Selection(source_fps=10, end_s=100, max_frames=9))
    assert len(clip.frames) == 9


def _opened(path: Path, selection: Selection) -> tuple[Any, list[float]]:
    source = open_source(path, selection, None)
    return source.pictures, source.times_s()


def test_the_positions_of_a_drones_subtitles_reach_the_frames(tmp_path: Path) -> None:
    video = write_video(tmp_path / "DJI_0001.MP4", IMAGES, [i / 10 for i in range(9)])
    video.with_suffix(".SRT").write_text(
        "1\n00:00:00,000 --> 00:00:00,400\n[latitude: 52.50] [longitude: 13.4] [rel_alt: 30.0 abs_alt: 91]\n\n"
        "2\n00:00:00,400 --> 00:00:00,800\n[latitude: 52.54] [longitude: 13.4] [rel_alt: 34.0 abs_alt: 95]\n"
    )
    positions = [f.position for f in clip_of(video, tmp_path / "clip").frames]
    assert [p and round(p.latitude_deg, 6) for p in positions][:5] == [52.5, 52.51, 52.52, 52.53, 52.54]
    assert positions[2] is not None
    assert positions[2].altitude_m == pytest.approx(32)


def test_photographs_that_are_made_smaller_keep_their_focal_length(tmp_path: Path) -> None:
    source = tmp_path / "photographs"
    source.mkdir()
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 28  # focal length in 35 mm film
    for i, image in enumerate(IMAGES[:3]):
        Image.fromarray(image).save(source / f"{i}.jpg", quality=95, exif=exif)
    smaller = Selection(longest_px=160)
    clip = clip_of(source, tmp_path / "clip", smaller)
    assert (clip.width, clip.height) == (160, 120)
    assert clip.source_size == (320, 240)
    assert open_source(source, smaller, None).focal_share == pytest.approx(28 / 35, rel=0.05)
    assert open_source(aerial.write(tmp_path / "frames", IMAGES[:3]), Selection(), None).focal_share is None


def test_photographs_of_another_focal_length_than_most_are_left_out(tmp_path: Path) -> None:
    """A zoom, or another camera: frames of one lens are reconstructed."""
    source = tmp_path / "photographs"
    source.mkdir()
    for i, image in enumerate(IMAGES):
        exif = Image.Exif()
        if i != 8:  # one that says nothing is taken for one of most
            exif.get_ifd(0x8769)[0xA405] = 50 if i in (0, 3) else 28  # focal length in 35 mm film
        Image.fromarray(image).save(source / f"{i}.jpg", quality=95, exif=exif)
    opened = open_source(source, Selection(source_fps=10.0), None)
    assert opened.focal_share == pytest.approx(28 / 35, rel=0.05)
    assert [file.name for file in opened.files] == [f"{i}.jpg" for i in (1, 2, 4, 5, 6, 7, 8)]
    assert opened.notes == ["0.jpg, 3.jpg left out: EXIF's focal length is not that of most"]
    assert opened.times_s() == pytest.approx([0, 0.1, 0.3, 0.4, 0.5, 0.6, 0.7])


def test_a_video_without_its_index_is_refused(tmp_path: Path) -> None:
    video = write_video(tmp_path / "broken.mp4", IMAGES, [i / 10 for i in range(9)])
    cut_short(video, 0.7)
    with pytest.raises(InputError, match=r"broken\.mp4: cannot be opened as a video .* repair"):
        clip_of(video, tmp_path / "clip")


def test_a_video_held_upright_is_turned(tmp_path: Path) -> None:
    video = write_video(tmp_path / "portrait.mp4", IMAGES, [i / 10 for i in range(9)])
    turn_clockwise(video)
    clip = clip_of(video, tmp_path / "clip")
    assert (clip.width, clip.height) == (aerial.HEIGHT, aerial.WIDTH)
    assert np.abs(pixels(clip, 4) - np.rot90(IMAGES[4], -1)).mean() < 12


def test_a_folder_with_one_frame(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="1 usable frame, and at least 3 are needed; give a longer clip"):
        clip_of(aerial.write(tmp_path / "one", IMAGES[:1]), tmp_path / "clip")


def test_an_empty_folder_and_nothing_at_all(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="holds no picture"):
        open_source(tmp_path / "empty", Selection(), None)
    with pytest.raises(InputError, match="not found; give a video"):
        open_source(tmp_path / "absent", Selection(), None)
    (tmp_path / "letter.pdf").write_text("x")
    with pytest.raises(InputError, match="neither a video nor a folder"):
        open_source(tmp_path / "letter.pdf", Selection(), None)


def test_frames_of_two_sizes(tmp_path: Path) -> None:
    source = aerial.write(tmp_path / "frames", IMAGES)
    aerial.write_one(source / "frame_0003.png", np.asarray(cv2.resize(IMAGES[3], (160, 120)), np.uint8))
    clip = clip_of(source, tmp_path / "clip")
    assert len(clip.frames) == 8
    assert any("frame_0003.png left out: of another size" in note for note in clip.notes)


def test_files_that_are_no_pictures_and_damaged_ones(tmp_path: Path) -> None:
    source = aerial.write(tmp_path / "frames", IMAGES)
    (source / "notes.txt").write_text("x")
    (source / "Thumbs.db").write_bytes(b"x")
    (source / "frame_0009.png").symlink_to("nowhere.png")
    damaged = source / "frame_0004.png"
    damaged.write_bytes(damaged.read_bytes()[:500])
    clip = clip_of(source, tmp_path / "clip")
    assert len(clip.frames) == 8
    assert any("Thumbs.db, frame_0009.png, notes.txt left out: no picture" in note for note in clip.notes)
    assert any("frame_0004.png left out" in note for note in clip.notes)


def sixteen_bit(image: np.ndarray) -> Image.Image:
    return Image.fromarray((image.mean(axis=2) * 257).astype(np.uint16))


def sixteen_bit_colour(image: np.ndarray) -> SavedByOpenCV:
    return SavedByOpenCV(image.astype(np.uint16) * 257)


class SavedByOpenCV:
    """Pillow writes no 16-bit colour."""

    def __init__(self, image: np.ndarray) -> None:
        self.image = image

    def save(self, path: Path) -> None:
        path.write_bytes(cv2.imencode(path.suffix, self.image[..., ::-1])[1].tobytes())


def with_alpha(image: np.ndarray) -> Image.Image:
    return Image.fromarray(np.dstack([image, np.full(image.shape[:2], 255, np.uint8)]))


@pytest.mark.parametrize(
    ("convert", "ending", "grey"),
    [
        (sixteen_bit, "png", True),
        (sixteen_bit_colour, "png", False),
        (lambda i: Image.fromarray(i).convert("L"), "png", True),
        (lambda i: Image.fromarray(i).convert("CMYK"), "jpg", False),
        (with_alpha, "png", False),
        (lambda i: Image.fromarray(i).convert("P", palette=Image.Palette.ADAPTIVE), "png", False),
        (lambda i: Image.fromarray(i), "tif", False),
    ],
    ids=["16-bit", "16-bit colour", "grey", "CMYK", "alpha", "palette", "tif"],
)
def test_pictures_of_every_kind_become_8_bit_rgb(
    tmp_path: Path, convert: Callable[[np.ndarray], Any], ending: str, grey: bool
) -> None:
    source = tmp_path / "frames"
    source.mkdir()
    for i, image in enumerate(IMAGES[:3]):
        convert(image).save(source / f"{i}.{ending}", **({"quality": 95} if ending == "jpg" else {}))
    clip = clip_of(source, tmp_path / "clip")
    with Image.open(clip.folder / clip.frames[1].file) as stored:
        assert stored.mode == "RGB"
    wanted = np.repeat(IMAGES[1].mean(axis=2, keepdims=True), 3, axis=2) if grey else IMAGES[1]
    assert np.abs(pixels(clip, 1) - wanted).mean() < 12


def test_a_photograph_that_was_taken_upright_is_turned(tmp_path: Path) -> None:
    source = tmp_path / "frames"
    source.mkdir()
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned clockwise
    for i, image in enumerate(IMAGES[:3]):
        Image.fromarray(image).save(source / f"{i}.jpg", quality=95, exif=exif)
    clip = clip_of(source, tmp_path / "clip")
    assert (clip.width, clip.height) == (aerial.HEIGHT, aerial.WIDTH)
    assert np.abs(pixels(clip, 1) - np.rot90(IMAGES[1], -1)).mean() < 12


def test_identical_frames(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"1 usable frame.*repeat the frame before.*in which the drone moves"):
        clip_of(aerial.write(tmp_path / "still", [IMAGES[0]] * 6), tmp_path / "clip")


def test_copies_under_other_names_are_left_out(tmp_path: Path) -> None:
    source = aerial.write(tmp_path / "frames", IMAGES)
    for i, image in enumerate(IMAGES):
        aerial.write_one(source / f"Copy of frame_{i:04}.png", image)
    clip = clip_of(source, tmp_path / "clip")
    assert [frame.label for frame in clip.frames] == [f"Copy of frame_{i:04}.png" for i in range(9)]
    assert any("left out: copies of an earlier frame" in note for note in clip.notes)


def test_what_is_left_out_is_named_whatever_was_before_it(tmp_path: Path) -> None:
    """One frame of another size, one twice, one once more at the end, one blurred: each by its own reason."""
    images = [*IMAGES, IMAGES[1]]
    images[0], images[3], images[6] = images[0][::2, ::2], images[2], blurred(images[6], 4)
    clip = clip_of(aerial.write(tmp_path / "frames", images), tmp_path / "clip")
    assert clip.notes == (
        "frame_0000.png left out: of another size than most",
        "frame_0003.png left out: repeat the frame before",
        "frame_0009.png left out: copies of an earlier frame",
        "frame_0006.png left out: blurred",
    )
    assert [frame.label for frame in clip.frames] == [f"frame_{i:04}.png" for i in (1, 2, 4, 5, 7, 8)]


def blurred(image: np.ndarray, sigma_px: float) -> np.ndarray:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.uint8)


def test_a_blurred_frame_is_left_out(tmp_path: Path) -> None:
    images = [*IMAGES]
    images[4] = blurred(images[4], 4)
    clip = clip_of(aerial.write(tmp_path / "frames", images), tmp_path / "clip")
    assert [f.label for f in clip.frames if f.label == "frame_0004.png"] == []
    assert any("frame_0004.png left out: blurred" in note for note in clip.notes)


def test_of_a_video_the_sharpest_frame_of_each_tick_is_taken(tmp_path: Path) -> None:
    source = aerial.write(tmp_path / "frames", [i for image in IMAGES for i in (blurred(image, 3), image)])
    clip = clip_of(source, tmp_path / "clip", Selection(source_fps=20, rate=10.001))
    numbers = [f.number for f in clip.frames]
    assert len(numbers) >= 8
    assert all(n is not None and n % 2 == 1 for n in numbers)


def test_a_strip_is_no_frame(tmp_path: Path) -> None:
    source = aerial.write(tmp_path / "frames", IMAGES[:3])
    for i in range(3, 6):
        Image.new("RGB", (17_000, 20)).save(source / f"frame_000{i}.png")
    clip = clip_of(source, tmp_path / "clip")
    assert len(clip.frames) == 3
    assert any("frame_0004.png left out: 17000x20 pixels are no frame of a camera" in n for n in clip.notes)


@pytest.mark.skipif(sys.platform != "linux", reason="names there are text")
def test_names_that_are_no_text(tmp_path: Path) -> None:
    source = aerial.write(tmp_path / "frames", IMAGES)
    (source / os.fsdecode(b"notes\xff.txt")).touch()
    (source / "frame_0000.png").rename(source / os.fsdecode(b"fr\xe9me_0000.png"))
    made = make_capture(source, tmp_path / "capture", SETTINGS, None, silent)
    assert "notes\\xff.txt left out: no picture" in made.notes
    assert "fr\\xe9me_0000.png" in made.report.read_text()
    assert made.frames == 9
    with pytest.raises(InputError, match="file name is not valid UTF-8"):
        make_capture(source, tmp_path / os.fsdecode(b"\xe9"), SETTINGS, None, silent)


def test_a_rate_and_subtitles_that_say_nothing_are_told(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", IMAGES, [i / 10 for i in range(9)])
    video.with_suffix(".SRT").write_text("1\n00:00:00,000 --> 00:00:01,000\n[latitude: 0.0] [longitude: 0.0]\n")
    notes = open_source(video, Selection(source_fps=77), None).notes
    assert notes == [
        "--fps 77 is ignored: a video says its own times",
        "a.SRT holds no usable position and is not used",
    ]
    later = "1\n00:01:40,000 --> 00:01:41,000\n[latitude: 52.5] [longitude: 13.4]\n"
    video.with_suffix(".SRT").write_text(later)
    (note,) = clip_of(video, tmp_path / "clip").notes
    assert note.startswith("the positions in a.SRT are of 100.0 s to 100.0 s, the video ends at 0.8 s: they are not")
    video.with_suffix(".SRT").unlink()
    assert open_source(video, Selection(), None).notes == []


def test_a_video_of_one_frame_does_not_end_early(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", IMAGES[:1], [0.0])
    with pytest.raises(InputError, match="1 usable frame, and at least 3 are needed; give a longer clip"):
        clip_of(video, tmp_path / "clip")


def test_names_without_numbers_go_by_the_alphabet(tmp_path: Path) -> None:
    source = tmp_path / "frames"
    source.mkdir()
    for name, image in zip("dbca", IMAGES, strict=False):
        aerial.write_one(source / f"{name}.png", image)
    clip = clip_of(source, tmp_path / "clip")
    assert [f.label for f in clip.frames] == ["a.png", "b.png", "c.png", "d.png"]
    assert any("file names do not number the frames" in note for note in clip.notes)


def test_a_gap_in_the_numbers_is_a_gap_in_time(tmp_path: Path) -> None:
    source = tmp_path / "frames"
    source.mkdir()
    for number, image in zip((8, 9, 10, 100), IMAGES, strict=False):
        aerial.write_one(source / f"DJI_{number}.png", image)
    clip = clip_of(source, tmp_path / "clip", Selection(source_fps=10, rate=1000))
    assert [f.time_s for f in clip.frames] == pytest.approx([0, 0.1, 0.2, 9.2])


def test_a_camera_that_only_turns(tmp_path: Path) -> None:
    source = aerial.write(tmp_path / "frames", aerial.pictures(aerial.turning()))
    with pytest.raises(InputError, match=r"no cameras could be reconstructed: the camera only turns.*--start, --end"):
        make_capture(source, tmp_path / "capture", SETTINGS, None, silent)
    # The same command would meet the same refusal: nothing is left that it could go on from.
    assert not (tmp_path / "capture").exists()


def test_frames_with_nothing_in_common(tmp_path: Path) -> None:
    images = [aerial.texture(seed)[:240, :320] for seed in range(4)]
    source = aerial.write(tmp_path / "frames", images)
    with pytest.raises(InputError, match="no two frames have enough in common; use frames that lie closer"):
        make_capture(source, tmp_path / "capture", SETTINGS, None, silent)


def test_a_cut_keeps_the_larger_part_and_lists_the_other(tmp_path: Path) -> None:
    first = aerial.pictures(aerial.arc(8))
    second = aerial.pictures(aerial.arc(5, 40), lambda _: aerial.town(3))
    source = aerial.write(tmp_path / "a flight, été 飞行" / "frames", first + second)
    made = make_capture(source, tmp_path / "my capture, été", SETTINGS, None, silent)
    assert made.frames == 8
    note = next(n for n in made.notes if "second part of the clip" in n)
    assert "5 frames from frame_0008.png to frame_0012.png" in note
    assert any("falls into parts" in line.what for line in made.advice)
    capture = read_capture(made.folder)
    assert [f.t for f in capture.frames] == pytest.approx(np.linspace(0, 1, 8))


def test_frames_without_a_pose_are_left_out_and_named(tmp_path: Path) -> None:
    cameras = aerial.arc(12)
    elsewhere = [aerial.picture(aerial.town(20 + i), cameras[i]) for i in range(12)]
    images = [image if i % 2 else elsewhere[i] for i, image in enumerate(aerial.pictures(cameras))]
    source = aerial.write(tmp_path / "frames", images)
    made = make_capture(source, tmp_path / "capture", SETTINGS, None, silent)
    assert (made.frames, made.used) == (6, 12)
    assert any("6 frames (frame_0000.png" in note and "no pose could be found" in note for note in made.notes)
    assert any("Some frames could not be placed" in line.what for line in made.advice)
    assert "What would help" in made.report.read_text()
    # Times are those of the frames that are left.
    assert [f.time_s for f in read_capture(made.folder).frames] == pytest.approx(0.2 * np.arange(6))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--rate", "0"], "--rate: 0.0 is out of range; it must be a number from 0.001 to 1000000"),
        (["--rate", "nan"], "--rate: must be a number from 0.001 to 1000000, not nan"),
        (["--rate", "inf"], "--rate: must be a number from 0.001 to 1000000, not inf"),
        (["--start", "5", "--end", "3"], "--start, --end: the end, 3 s, must lie after the start, 5 s"),
        (["--end", "inf"], "--end: must be a number from 0 to 1000000000, not inf"),
        (["--max-frames", "1"], "--max-frames: 1 is out of range; it must be a whole number from 3"),
        (["--altitude", "-3"], "--altitude: -3.0 is out of range"),
        (
            ["--size", "100000000000000000000"],
            "--size: 100000000000000000000 is out of range; it must be a whole number fr",
        ),
        (["--fps", "1e300"], "--fps: 1e+300 is out of range"),
        (["--threads", "1000000"], "--threads: 1000000 is out of range; it must be a whole number from 1 to 256"),
    ],
)
def test_impossible_settings_are_refused_by_name(
    tmp_path: Path, arguments: list[str], says: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from aa4d.cli import main

    source = aerial.write(tmp_path / "frames", IMAGES[:3])
    monkeypatch.setattr(sys, "argv", ["aa4d", "capture", str(source), "--out", str(tmp_path / "c"), *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "c").exists()
