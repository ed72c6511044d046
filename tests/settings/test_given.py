"""A settings file, `--set` and options: how they are read, and which of them wins."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from aa4d.capture.settings import PRESETS as CAPTURE_PRESETS
from aa4d.capture.settings import CaptureSettings, Selection
from aa4d.errors import InputError
from aa4d.methods.adaanchor4d.settings import PRESETS, AdaAnchor4DSettings
from aa4d.methods.settings import MotionSettings
from aa4d.settings.given import Given
from aa4d.settings.toml import MOST_BYTES, as_toml

QUICK = PRESETS["quick"]


def assigned(*assignments: str) -> AdaAnchor4DSettings:
    return Given.by(None, assignments).applied(QUICK)


def refusal(*assignments: str) -> str:
    with pytest.raises(InputError) as error:
        assigned(*assignments)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_the_later_of_file_assignments_and_options_wins(tmp_path: Path) -> None:
    file = tmp_path / "run.toml"
    file.write_text("seed = 1\ncheckpoint_every = 11\nvoxel_px = 3\n[loss]\ndssim = 0.1\n")
    options = {"--seed": ("seed", 3), "--every": ("checkpoint_every", None)}
    config = Given.by(file, ["seed=2", "checkpoint_every = 22"], options).applied(QUICK)
    assert (config.seed, config.checkpoint_every, config.voxel_px, config.loss.dssim) == (3, 22, 3.0, 0.1)
    assert config.rates == QUICK.rates


def test_values_are_those_of_toml_and_words_need_no_quotes() -> None:
    assert assigned("motion.tracks=boxes").motion == assigned("motion.tracks = 'boxes'").motion
    assert assigned("refine_poses=true").refine_poses is True
    assert assigned("loss.dssim=1e-2").loss.dssim == 0.01
    assert assigned("rates.planes={initial=0.2, final=0.1}").rates.planes.initial == 0.2
    assert assigned("loss={dssim=0.3}", "loss.volume=1").loss.dssim == 0.3


def test_riding_is_off_with_none_and_on_with_any_of_its_keys() -> None:
    assert assigned("motion.voxel_px=3").motion == MotionSettings(voxel_px=3)
    assert assigned("motion={}").motion == MotionSettings()
    assert assigned("motion=none").motion is None
    riding = Given.by(None, ["motion.voxel_px=3"], {"--motion": ("motion", "none")})
    assert riding.applied(QUICK).motion is None  # the option came last


@pytest.mark.parametrize(
    ("assignments", "says"),
    [
        (["loss.dssim"], "--set loss.dssim: write KEY=VALUE"),
        (["loss.dssim="], "--set loss.dssim=: write KEY=VALUE"),
        (["=1"], "--set =1: write KEY=VALUE"),
        (["loss..dssim=1"], "write KEY=VALUE"),
        (['"loss".dssim=1'], "write KEY=VALUE"),
        (["\x1b[31m=1"], '--set "\\u001b[31m=1": write KEY=VALUE'),
        (["seed=1", "seed=2"], "--set seed: seed is given already, as the number 1; leave one of them out"),
        (["loss.dssim=1", "loss={dssim=1}"], "--set loss: dssim is given already"),
        (["motion=none", "motion.tracks=auto"], '--set motion.tracks: motion is given already, as the text "none"'),
        (["loss=1"], "--set loss: is a section, with the keys dssim"),
        (["seed.x=1"], "--set seed: a table must be a whole number"),
        (["seed=1979-05-27"], "--set seed: the date 1979-05-27 must be a whole number"),
        (["seed=1\npreset='x'"], "--set seed: the text \"1\\npreset='x'\" must be"),
        (["seed=" + "[" * 5000], "--set seed: the text"),
        (["seed=" + "9" * 5000], "--set seed: the text"),
        (
            ["rates.planes.initial=-1"],
            "--set rates.planes.initial: -1 is out of range; it must be a number from 1e-12 to 10",
        ),
        (["warp.lambda_min=0.9"], "--set warp: lambda_min is 0.9, above lambda_max, which is 0.8"),
        (["motion.tracks=box"], "must be one of auto, pictures, boxes, truth; did you mean boxes?"),
    ],
)
def test_an_assignment_that_makes_no_sense_is_refused(assignments: list[str], says: str) -> None:
    assert says in refusal(*assignments)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"seed = 1\nseed = 2\n", "run.toml: is not TOML: Cannot overwrite a value"),
        (b"seed = \n", "run.toml: is not TOML: Invalid value (at line 1, column 8)"),
        (b"seed = 1\xff\n", "run.toml: is not UTF-8 text"),
        (b"seed = 1979-05-27T07:32:00Z\n", "run.toml: seed: the datetime 1979-05-27 07:32:00+00:00 must be"),
        (b"seed = " + b"9" * 5000, "run.toml: is not TOML: Exceeds the limit"),
        (b"seed = " + b"[" * 100_000, "run.toml: is not TOML: "),
        (b"loss = [1]\n", "run.toml: loss: is a section"),
        (b"[[loss]]\n", "run.toml: loss: is a section, with the keys dssim"),
        (b'"" = 1\n', 'run.toml: "": unknown key'),
        (b"#" * (MOST_BYTES + 1), "run.toml: larger than 1 MiB"),
        (b"seed = nan", "run.toml: seed: the number nan must be a whole number"),
    ],
)
def test_a_bad_file_is_refused_by_name(content: bytes, says: str, tmp_path: Path) -> None:
    file = tmp_path / "run.toml"
    file.write_bytes(content)
    with pytest.raises(InputError) as error:
        Given.by(file).applied(QUICK)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such settings file"):
        Given.by(tmp_path / "absent.toml")
    with pytest.raises(InputError, match="is a folder"):
        Given.by(tmp_path)
    with pytest.raises(InputError, match="larger than 1 MiB"):
        Given.by(Path("/dev/zero"))


@pytest.mark.parametrize("content", [b"", b"\n# nothing\n", b"\xef\xbb\xbfseed = 0\r\n"])
def test_an_empty_file_and_a_byte_order_mark_are_fine(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / "run.toml"
    file.write_bytes(content)
    assert Given.by(file).applied(QUICK) == QUICK


@pytest.mark.skipif(os.name != "posix", reason="needs pipes with a name")
def test_a_pipe_is_a_file(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_text, args=("seed = 5\n",))
    writer.start()
    assert Given.by(pipe).applied(QUICK).seed == 5
    writer.join()


@pytest.mark.parametrize("preset", CAPTURE_PRESETS)
def test_the_settings_of_a_capture_are_read_back_too(preset: str, tmp_path: Path) -> None:
    settings = CaptureSettings(preset, CAPTURE_PRESETS[preset], Selection(rate=2.5, end_s=9.0), fov_deg=70.0)
    file = tmp_path / "settings.toml"
    file.write_text(as_toml(settings, "of a capture"))
    assert Given.by(file).applied(CaptureSettings("fast", CAPTURE_PRESETS["fast"])) == settings


def test_a_name_is_chosen_once_and_nearly_right_ones_are_told(tmp_path: Path) -> None:
    file = tmp_path / "run.toml"
    file.write_text('preset = "paper"\n')
    assert Given.by(None).chosen("preset", PRESETS, "quick") == "quick"
    assert Given.by(file).chosen("preset", PRESETS, "quick") == "paper"
    assert Given.by(file, (), {"--preset": ("preset", "paper")}).chosen("preset", PRESETS, "quick") == "paper"
    with pytest.raises(InputError, match=r"--preset quick: .*run\.toml: preset says paper; leave one of them out"):
        Given.by(file, (), {"--preset": ("preset", "quick")}).chosen("preset", PRESETS, "quick")
    with pytest.raises(InputError, match=r'--set preset: the text "papre" must be one of .*; did you mean paper\?'):
        Given.by(None, ["preset=papre"]).chosen("preset", PRESETS, "quick")
