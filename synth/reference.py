"""Writes docs/scenes.md from the declarations of the keys: `python -m synth.reference > docs/scenes.md`.

A test holds the file to this text, so that it cannot go stale.
"""

import dataclasses
import sys
from collections.abc import Iterator
from importlib import import_module
from typing import Any, Literal, get_args, get_origin, get_type_hints

from synth.checking import REQUIRED, without_none
from synth.effects import NAMES
from synth.spec import Scene

HEAD = """\
# Scene files

<!-- Written by `python -m synth.reference > docs/scenes.md` from the declarations in `synth/`: change those. -->

A scene is a TOML file; `scenes/crossroads.toml` is one to start from, `scenes/arc01.toml` to `arc10.toml` show what
there is. It is checked before anything is rendered: an unknown key, a wrong type, a value out of range or a missing key
is refused with the file, the key and what would be allowed. A key without a default must be given.

The world is right-handed with z up, in meters, its origin in the middle of the street; east is +x, north is +y. Angles
of directions run counter-clockwise from east. Colors are linear RGB. Traffic keeps to the right.

```
aa4d synth scenes/crossroads.toml --out captures/crossroads
aa4d synth scenes/crossroads.toml --explain                    what it would render, and about how long
blender -b -P synth/render_flyover.py -- scenes/crossroads.toml --out captures/crossroads
```

The same file, seed and version of Blender give the same frames, byte for byte.

The scene's own ground is a square of 1.2 km. Where a frame looks beyond it, level land goes on to the horizon, at any
altitude and pitch. The camera alone sees it: what stands in the scene is lit as without it, and what was hit before
keeps its pixels and its depth to the bit (a denoised picture may change beside the new land). A pixel of land costs
what one of lawn does: at 120 m and a pitch of -15 degrees, where a quarter of the picture is land that was empty, a
picture of the tiny scene at 480x270 and 8 samples took 3.0 s of one core instead of 2.2 s; from 1,900 m at -20
degrees, where all of it is, 3.1 s instead of 0.2 s.

## The ten arc scenes

![Frame, depth, flow and activity of each of the ten arc scenes](images/arcs.jpg)

*`aa4d synth sheet scenes/arc*.toml --out sheet`: the third of four frames from the middle of each clip, at draft
quality (4 samples, denoised). Hue of the flow: where to; brightness: how far.*

The same command says what a scene costs at that quality, 480x270 pixels, with depth, ids, flow and activity: set-up
once (plan, traffic, building in Blender), loading of the geometry once in 24 frames, and then every frame. Its
seconds, the clip's from these (set-up + 4 loads + 80 frames), on two cores of which others took most (load 6 to 8):

| scene | set-up | load | a frame's picture | its truth | the clip of 80 frames |
|---|---|---|---|---|---|
| arc01 | 4.0 | 2.9 | 5.7 | 1.2 | 574 |
| arc02 | 1.1 | 0.8 | 3.9 | 0.8 | 376 |
| arc03 | 3.6 | 1.5 | 5.3 | 1.3 | 532 |
| arc04 | 1.3 | 3.0 | 6.4 | 1.2 | 624 |
| arc05 | 1.9 | 2.8 | 4.4 | 0.9 | 442 |
| arc06 | 1.6 | 1.4 | 3.3 | 0.8 | 339 |
| arc07 | 4.9 | 1.8 | 7.3 | 1.7 | 732 |
| arc08 | 5.0 | 2.2 | 7.8 | 1.5 | 762 |
| arc09 | 6.2 | 3.3 | 3.8 | 1.2 | 425 |
| arc10 | 1.6 | 0.9 | 3.9 | 0.8 | 374 |
"""
TAIL = """\
## What traffic does

Vehicles keep their distance by the intelligent driver model and change lanes by MOBIL, along a path that is smooth in
place: one that stands keeps its heading. A junction is entered with a grant. Green lights, people on the zebra
crossings, vehicles that are still inside and those that have the right of way decide; straight on goes before right
before left, the major street and the ring of a roundabout before those that join. Whoever would have to brake harder
than 4 m/s² when the light turns red drives on. Of two vehicles of 8 m or more that would touch in a bend, into and out
of a roundabout by the same arm for instance, the one with less right of way waits. Positions between two steps are
those of constant acceleration: exact for the simulation at any real time. The clip is checked ten times a second, and
two bodies nearer than 0.1 m are refused with their names and the time where the scene places both. Of others the one
that was drawn gives way: people walk another way, vehicles are left out; how many is said before rendering and by
`--explain`.

A vehicle that comes or goes during the clip is absent before and after (`present` in `truth/tracks.npz`).

## Tracks

`format = "sumo"` reads what SUMO's `--fcd-output` writes, as CSV or XML. Its positions are those of the front bumper,
its angles run clockwise from north; both are converted. Steps that are whole milliseconds need not fit the frames:
positions between samples lie on a curve that never overshoots, and headings come from where the axles are, so that
neither SUMO's sideways jump at a lane change nor a standing vehicle turns a body on the spot. `format = "metres"` reads
measured tracks; where these are shorter than the kinds that stand for them, bodies touch in a queue, which `overlaps =
"allow"` lets pass. Who is not there during the clip is left out; `start_s` says where in the table it starts.

What the table does not say is not made up. Over a gap in a track its road user is absent (`present`); a curve bridges
no more than one and a half of the table's usual steps, or half a second, or `bridge_s`. A step that nobody could have
driven - over 70 m/s, 25 for cyclists, 12 on foot, or too far for the speed before and after it and 9 m/s² - is refused
with its name and time, or with `jumps = "split"` left out between its two samples. SUMO's step to the next lane within
one step becomes a change of lane of two seconds. Gaps and rows that are left out are counted before rendering and by
`--explain`.

`scale`, `recentre`, `turn_deg` and `shift_m`, in this order, place a table on the street. `--explain` and the rendering
say which share of the vehicles' way lies off the road: on curbs, pavements, lawns, or beyond the scene's ground.

SUMO's floating car data names a vehicle's type, not its class. `types` is the file with SUMO's `<vType>` elements,
whose `vClass` decides; without it the whole words of the type's name do: `bus_1` is a bus, `rebus` is not. Where no
word tells, a saloon is shown; trams stand in as buses, motorcycles and mopeds as cyclists. Both are said, once for each
type.

Coordinates beyond 10 km, a UTM grid for instance, are refused unless `recentre` is true: at 500 km Blender's optical
flow is wrong by up to 0.7 pixels.

## The heterogeneity family

The scenes of `scenes/heterogeneity/` are the same file but for one knob, their lights: street, blocks, flight, sun and
demand are equal, and the mix of activity classes moves from static (`standing`) over intermittent (`stop-and-go`) and
all of them (`mixed`) to persistent beside static (`free-flow`).

Those of `scenes/heterogeneity/controlled/` have two knobs that vary apart (`python -m synth.family` writes them): four
cars go the same way in the same time, two of them at every instant. `lanes1`, `lanes2` and `lanes4` spread them over
the street, which sets how much of the ground is ever active; with `changes1` to `changes3` they change places that
often, which sets how often a place changes between motion and rest. A second drone films them too.
"""


def reference() -> str:
    """The whole page."""
    parts = [HEAD, "## The top of the file\n\n" + "\n".join(_top(Scene)) + "\n"]
    for name, hint, metadata in _tables(Scene):
        if metadata.get("kinds") and metadata["meaning"]:  # another one of what a table before it describes
            parts.append(f"## `[{name}]`\n\n{metadata['meaning']} Its keys are those of `[flight]`.\n")
            continue
        if metadata.get("kinds"):
            kinds = _listed(metadata["kinds"])
            parts.append(f"## `[{name}]`\n\n`kind` chooses one of {kinds}; the other keys depend on it.\n")
            for kind, cls in metadata["kinds"].items():
                parts.append(_section(f'`[{name}]` with `kind = "{kind}"`', cls, _rows(cls), level=3))
            continue
        many = get_origin(hint) is tuple
        cls = get_args(hint)[0] if many else hint
        parts.append(_section(f"`[[{name}]]`" if many else f"`[{name}]`", cls, _rows(cls)))
    parts.append("## `[effects.NAME]`\n\nAn effect that the scene does not name is neither imported nor simulated.\n")
    for name in NAMES:
        module = import_module(f"synth.effects.{name}")
        about = (module.__doc__ or "").strip().split("\n\n")[0].replace("\n", " ")
        parts.append("\n".join([f"### `[effects.{name}]`", "", about, "", *_rows(module.Settings), ""]))
    parts.append(TAIL)
    return "\n".join(parts)


def _section(title: str, cls: type, rows: list[str], level: int = 2) -> str:
    about = " ".join((cls.__doc__ or "").split())
    return f"{'#' * level} {title}\n\n{about}\n\n" + "\n".join(rows) + "\n"


def _fields(cls: type) -> Iterator[tuple[str, Any, dataclasses.Field[Any]]]:
    hints = get_type_hints(cls)
    for each in dataclasses.fields(cls):
        yield each.name, without_none(hints[each.name]), each


def _is_table(hint: Any, metadata: Any) -> bool:
    item = get_args(hint)[0] if get_origin(hint) is tuple else hint
    return bool(metadata.get("kinds")) or dataclasses.is_dataclass(item)


def _tables(cls: type) -> Iterator[tuple[str, Any, Any]]:
    return ((name, hint, f.metadata) for name, hint, f in _fields(cls) if _is_table(hint, f.metadata))


def _top(cls: type) -> list[str]:
    return _table((name, hint, f) for name, hint, f in _fields(cls)
                  if not _is_table(hint, f.metadata) and get_origin(hint) is not dict)  # fmt: skip


def _rows(cls: type) -> list[str]:
    return _table((name, hint, f) for name, hint, f in _fields(cls) if name != "kind" or len(get_args(hint)) != 1)


def _table(fields: Iterator[tuple[str, Any, dataclasses.Field[Any]]]) -> list[str]:
    rows = []
    for name, hint, each in fields:
        low_high = each.metadata.get("range")
        if get_origin(hint) is Literal:
            allowed = _listed(get_args(hint))
        elif low_high:
            allowed = f"{_number(low_high[0])} to {_number(low_high[1])}" + (" each" if get_origin(hint) else "")
        else:
            allowed = "true, false" if hint is bool else ""
        meaning = each.metadata.get("meaning", "").replace("|", "\\|")
        rows.append(f"| `{name}` | {each.metadata.get('unit', '')} | {allowed} | {_default(each)} | {meaning} |")
    return ["| key | unit | range | default | meaning |", "|---|---|---|---|---|", *rows] if rows else []


def _default(each: dataclasses.Field[Any]) -> str:
    if each.default is REQUIRED:
        return ""
    return _value(each.default)


def _value(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (tuple, list)):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, str):
        return f'"{value}"'
    return _number(value)


def _number(value: float) -> str:
    return f"{value:.10g}"


def _listed(names: Any) -> str:
    return ", ".join(f'`"{name}"`' for name in names)


if __name__ == "__main__":
    sys.stdout.write(reference())
