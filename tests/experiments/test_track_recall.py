import json
from pathlib import Path

import pytest

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.experiments.track_recall import main, thinned


def test_a_thinned_capture_trains_on_every_nth_frame_and_keeps_what_is_held_out(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    thin = thinned(capture, 3)
    assert thin.of_split("train") == capture.of_split("train")[::3]
    assert thin.of_split("test") == capture.of_split("test")
    assert len(thin.frames) == len(capture.frames), "truth is indexed by all frames"
    assert thin.identity.digest() != capture.identity.digest()
    assert thin.identity.digest() != thinned(capture, 2).identity.digest()


def test_a_capture_without_true_tracks_is_refused_before_anything_is_trained(toy_capture: Path, tmp_path: Path) -> None:
    index = toy_capture / "capture.json"
    document = json.loads(index.read_text())
    del document["tracks"]
    index.write_text(json.dumps(document))
    with pytest.raises(InputError, match="has no true tracks; give a capture of `aa4d synth`"):
        main((toy_capture,), tmp_path / "out")
    assert not (tmp_path / "out").exists()
