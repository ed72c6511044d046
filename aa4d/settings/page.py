"""Writes docs/settings.md from the declarations of the settings: `python -m aa4d.settings.page > docs/settings.md`.

A key's meaning is the comment behind it, which may begin with where its value comes from, in brackets. A test holds the
file to this text, so that it cannot go stale.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
import tokenize
from collections.abc import Iterator, Mapping
from io import StringIO
from typing import Any, get_type_hints

from aa4d.capture.settings import PRESETS as CAPTURE_PRESETS
from aa4d.capture.settings import CaptureSettings
from aa4d.methods import METHODS, presets_of
from aa4d.settings.checking import expected, is_optional, without_none
from aa4d.settings.toml import toml_value

HEAD = """\
# Settings

<!-- Written by `python -m aa4d.settings.page > docs/settings.md` from the declarations in `aa4d/`: change those. -->

Every setting of training and of making a capture can be given by a file and on the command line:

```
aa4d train CAPTURE --out RUN --config run.toml --set loss.dssim=0.1 --set rates.planes.initial=0.05
aa4d capture VIDEO --out CAPTURE --set reconstruction.features=4000
aa4d sweep gamma CAPTURE --out SWEEP --config run.toml          every variant starts from these settings
```

A file has the keys of the tables below, a section each; what it leaves out is the preset's:

```
method = "adaanchor4d"
preset = "standard"
motion = "none"

[loss]
dssim = 0.1

[rates]
planes = { initial = 0.05, final = 0.005 }
```

- `--set KEY=VALUE` takes one key, with the sections before it, and a value as TOML writes it; a word needs no quotes.
- Of preset, `--config`, `--set` and the command's other options the last one that names a key counts; within one of
  them a key is given once. `method` and `preset` must be the same wherever they are given. `--iterations` comes after
  all and moves the window in which anchors or Gaussians come and go along with the fine stage; `fine_iterations` leaves
  it where it is.
- A setting without a value is `"none"`. A section that may be `"none"` is turned on by any of its keys, or by an empty
  table (`--set motion={}`). `aa4d train` starts with `[motion]` turned on for methods with anchors, which alone can
  ride; experiments start with it off.
- A misspelt key, a value of the wrong type or one outside of its range is refused before anything is done.
- `settings.toml` beside a result holds all that it was made with. Given with `--config` it makes the same again.

Where a value comes from: *paper*: it is stated there; *Scaffold-GS*, *4D-GS*, *D3DGS* (*paper* and *main* are two of
its branches), *SpeeDe3DGS*, *Grid4D*, *MoDec-GS* (*base* and *split-cookie* are two of its configurations),
*4D-SFGS*: the published code of those methods; *SD-GS*: its paper; *swept*: compared with others
([training.md](training.md)); *chosen*: settled without such a table. Lengths are those of the model's frame, in which
the scene is at unit depth, and pixels count at that depth.
"""
# Of the comment behind a field: "[swept] of the histogram, in bins".
COMMENT = re.compile(r"#\s*(?:\[(?P<source>[^\]]+)\][,;]?\s*)?(?P<meaning>.*)")


def page() -> str:
    """The whole text."""
    methods = [line for name in METHODS for line in _tree(f"Training: `{name}`", presets_of(name))]
    captures = {name: CaptureSettings(name, made) for name, made in CAPTURE_PRESETS.items()}
    return "\n".join([HEAD, *methods, *_tree("Capture", captures)])


def _tree(title: str, presets: Mapping[str, Any]) -> Iterator[str]:
    """A table of each section of one dataclass; where presets differ, a column has all of their values."""
    trees = list(presets.values())
    cls = type(trees[0])
    yield f"## {title}\n"
    yield f"Presets: {', '.join(f'`{name}`' for name in presets)}; where values differ, in this order.\n"
    hints = get_type_hints(cls, include_extras=True)
    plain = [f.name for f in dataclasses.fields(cls) if not _is_section(hints[f.name])]
    yield from _table(cls, [name for name in plain if name != "preset"], trees)
    for name in (f.name for f in dataclasses.fields(cls) if _is_section(hints[f.name])):
        section = without_none(hints[name])
        optional = ', or `"none"`' if is_optional(hints[name]) else ""
        yield f"### `[{name}]`{optional}\n"
        about = inspect.getdoc(section) or ""
        if not about.startswith(f"{section.__name__}("):  # what dataclasses say of themselves
            yield " ".join(about.split()) + "\n"
        values = [getattr(tree, name) for tree in trees]
        yield from _table(section, [f.name for f in dataclasses.fields(section)], [v or section() for v in values])


def _is_section(hint: Any) -> bool:
    return dataclasses.is_dataclass(without_none(hint))


def _table(cls: type, names: list[str], instances: list[Any]) -> Iterator[str]:
    hints, comments = get_type_hints(cls, include_extras=True), dict(_comments(cls))
    yield "| key | default | allowed | meaning | from |"
    yield "|---|---|---|---|---|"
    for name in names:
        found = COMMENT.match(comments.get(name, "#"))
        assert found is not None
        values = dict.fromkeys(_shown(getattr(instance, name)) for instance in instances)
        meaning = found["meaning"].replace("None:", '"none":')
        cells = (f"`{name}`", " / ".join(values), expected(hints[name]), meaning, found["source"] or "")
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
    yield ""


def _shown(value: Any) -> str:
    if dataclasses.is_dataclass(value):  # of a table within a section
        return " to ".join(_shown(getattr(value, field.name)) for field in dataclasses.fields(value))
    return toml_value(value)


def _comments(cls: type) -> Iterator[tuple[str, str]]:
    """The comment behind each field, by its name; a base class's come first."""
    for base in reversed(cls.__mro__[:-1]):
        fields, lines = inspect.get_annotations(base), inspect.cleandoc(inspect.getsource(base))
        for token in tokenize.generate_tokens(StringIO(lines).readline):
            name = token.line.split(":")[0].strip()
            if token.type == tokenize.COMMENT and name in fields:
                yield name, token.string


if __name__ == "__main__":
    sys.stdout.write(page())
