"""What is entered in a registry is found on the command line, and nothing else has to be changed for that."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

import pytest

from aa4d import commands
from aa4d.cli import COMMANDS, app_of
from aa4d.errors import InputError

REGISTRIES = [
    ("train", "aa4d.methods", "METHODS"),
    ("train", "aa4d.methods.adaanchor4d.settings", "PRESETS"),
    ("train", "aa4d.methods.fourdgs.settings", "PRESETS"),
    ("train", "aa4d.methods.modec.settings", "PRESETS"),
    ("train", "aa4d.motion.sources", "SOURCES"),
    ("train", "aa4d.device", "DEVICES"),
    ("capture", "aa4d.capture.settings", "PRESETS"),
    ("eval", "aa4d.evaluation.lpips", "STACKS"),
    ("eval", "aa4d.device", "DEVICES"),
    ("render", "aa4d.filming.layers", "LAYERS"),
    ("render", "aa4d.filming.layers", "PAINTINGS"),
    ("render", "aa4d.filming.splits", "SPLITS"),
    ("export", "aa4d.export", "EXPORTERS"),
    ("export", "aa4d.filming.splits", "SPLITS"),
    ("ablate", "aa4d.experiments.variants", "ABLATIONS"),
    ("ablate", "aa4d.methods.adaanchor4d.settings", "PRESETS"),
    ("sweep", "aa4d.experiments.variants", "SWEEPS"),
    ("compare", "aa4d.methods", "METHODS"),
    ("sweep", "aa4d.methods.adaanchor4d.settings", "PRESETS"),
    ("experiment", "aa4d.graph.engines", "ENGINES"),
    ("compare", "aa4d.graph.engines", "ENGINES"),
    ("synth", "aa4d.commands.synth", "COMMANDS"),
    ("bench", "aa4d.commands.bench", "COMMANDS"),
]


def help_of(command: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit):
        app_of(COMMANDS).cli(args=[command, "--help"])
    return capsys.readouterr().out


@pytest.mark.parametrize(("command", "module", "registry"), REGISTRIES)
def test_a_new_entry_is_a_choice(
    command: str, module: str, registry: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "novelty" not in help_of(command, capsys)
    entries = getattr(import_module(module), registry)
    if isinstance(entries, Mapping):
        monkeypatch.setitem(entries, "novelty", next(iter(entries.values())))
    else:
        monkeypatch.setattr(f"{module}.{registry}", (*entries, "novelty"))
    assert "novelty" in help_of(command, capsys)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["train", "x", "--out", "y", "--preset", "quik"], "--preset quik: must be one of .*; did you mean quick?"),
        (["train", "x", "--out", "y", "--tracks", "box"], "--tracks box: must be one of auto, .*; did you mean boxes?"),
        (["render", "x", "--layers", "color", "dept"], "--layers dept: must be one of color, .*; did you mean depth?"),
        (["export", "x", "--format", "usdc"], "--format usdc: must be one of ply, .*; did you mean usd?"),
        (["eval", "x", "--lpips", "alexnet"], "--lpips alexnet: must be one of .*; did you mean alex?"),
        (
            ["compare", "x", "--out", "y", "--methods", "fourdg"],
            "--methods fourdg: must be one of .*; did you mean fourdgs?",
        ),
        (["sweep", "gama", "x", "--out", "y"], "sweep gama: must be one of .*; did you mean gamma?"),
        (["capture", "x", "--out", "y", "--preset", "slow"], "--preset slow: must be one of fast, accurate$"),
    ],
)
def test_a_name_that_is_not_there_is_refused_with_the_nearest(arguments: list[str], says: str) -> None:
    with pytest.raises(InputError, match=says.replace("?", r"\?")):
        app_of(COMMANDS).cli(args=arguments)


def test_names_are_given_once_each_in_order() -> None:
    from aa4d.commands.choices import names_in

    spec = names_in("aa4d.device", "DEVICES", "--device")
    assert spec.instance_from_str(["cuda", "cpu", "cuda"]) == ("cuda", "cpu")


def test_names_have_blanks_or_commas_between_them_and_all_is_all() -> None:
    from aa4d.commands.choices import list_of, names_in

    panels = names_in("aa4d.cost", "PANELS", "--panels", "all").instance_from_str
    methods = list_of("aa4d.experiments.comparison", "entries", "--methods").instance_from_str
    assert methods(["grid4d, sdgs"]) == ("grid4d", "sdgs")
    assert methods(["grid4d,all"]) is None
    assert panels(["playback,export-formats", "playback"]) == ("playback", "export-formats")
    assert panels(["playback, ", "export-formats"]) == ("playback", "export-formats")
    assert panels(["all"]) is None
    for wrong in ("playbac", "", " , ", "none"):
        with pytest.raises(InputError, match=r"--panels .*: must be one of all, "):
            panels([wrong])
    with pytest.raises(InputError, match="--device all: must be one of auto"):
        names_in("aa4d.device", "DEVICES", "--device").instance_from_str(["all"])


def test_no_command_has_a_list_of_names_of_its_own() -> None:
    for path in Path(commands.__path__[0]).glob("*.py"):
        assert "Literal[" not in path.read_text(encoding="utf-8"), path


@pytest.mark.parametrize("arguments", [["--help"], ["train", "--help"], ["capture", "--help"], ["export", "--help"]])
def test_help_does_not_wait_for_torch(arguments: list[str]) -> None:
    program = (
        f"import sys; sys.argv = ['aa4d', *{arguments}]\n"
        "from aa4d.cli import main\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "assert 'torch' not in sys.modules"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr
