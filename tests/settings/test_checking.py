"""What a tree of settings takes, what it refuses, and in which words."""

from __future__ import annotations

import dataclasses
import random
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import pytest

from aa4d.errors import InputError
from aa4d.settings.allowed import Count, NameIn, Positive, Range, Share
from aa4d.settings.checking import changed, keys
from aa4d.settings.given import Given
from aa4d.settings.toml import as_toml

COLORS = {"red": 1, "green": 2}


@dataclass(frozen=True)
class Decay:
    initial: Positive
    final: Positive


@dataclass(frozen=True)
class Rates:
    planes: Decay = Decay(0.1, 0.01)
    heads: Decay = Decay(0.2, 0.02)


@dataclass(frozen=True)
class Motion:
    tracks: Literal["auto", "boxes"] = "auto"
    turn: Annotated[float, Range(-3, 3)] = 0.5


@dataclass(frozen=True)
class Window:
    start: Count = 1
    until: Count = 5

    def __post_init__(self) -> None:
        if self.start > self.until:
            raise ValueError(f"start is {self.start}, after until, which is {self.until}")


@dataclass(frozen=True)
class Tree:
    preset: str
    iterations: Count = 10
    is_deep: bool = False
    color: Annotated[str, NameIn(__name__, "COLORS")] = "red"
    rows: tuple[Count, ...] = (64, 128)
    box: tuple[Share, Share] = (0.25, 0.75)
    limit: Annotated[float, Range(0, 5)] | None = None
    motion: Motion | None = None
    rates: Rates = field(default_factory=Rates)
    window: Window = Window()


BASE = Tree("quick")


def with_table(table: dict[str, Any], base: Tree = BASE) -> Tree:
    return changed(base, table, lambda where: f"run.toml: {where}")


def refusal(table: dict[str, Any]) -> str:
    with pytest.raises(InputError) as error:
        with_table(table)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_what_is_not_named_stays() -> None:
    tree = with_table({"rates": {"planes": {"initial": 1}}, "box": [0, 1], "rows": [7]})
    assert tree == Tree("quick", rates=Rates(planes=Decay(1.0, 0.01)), box=(0.0, 1.0), rows=(7,))
    assert isinstance(tree.rates.planes.initial, float)
    assert with_table({}) == BASE


def test_an_optional_section_is_turned_on_by_its_keys_and_off_by_none() -> None:
    on = with_table({"motion": {"tracks": "boxes"}})
    assert on.motion == Motion("boxes")
    assert with_table({"motion": {}}).motion == Motion()
    assert with_table({"motion": {"turn": 1}}, on).motion == Motion("boxes", 1.0)
    assert with_table({"motion": "none"}, on).motion is None
    assert with_table({"limit": 2}).limit == 2.0
    assert with_table({"limit": "none"}, with_table({"limit": 2})).limit is None


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"iteration": 1}, "run.toml: iteration: unknown key; did you mean iterations? Allowed here: preset, iter"),
        ({"rates": {"plane": {}}}, "run.toml: rates.plane: unknown key; did you mean rates.planes?"),
        ({"turn": 1}, "run.toml: turn: unknown key; did you mean motion.turn?"),
        ({"zzz": 1}, "run.toml: zzz: unknown key; allowed here: preset"),
        ({"a\nb": 1}, 'run.toml: "a\\nb": unknown key; allowed here'),
        ({"iterations": 0}, "iterations: 0 is out of range; it must be a whole number from 1 to 10000000"),
        ({"iterations": 10**400}, "... is out of range; it must be a whole number from 1 to 10000000"),
        ({"iterations": 2.0}, "iterations: the number 2.0 must be a whole number from 1"),
        ({"iterations": True}, "iterations: true must be a whole number"),
        ({"is_deep": 1}, "is_deep: the number 1 must be true or false"),
        ({"rates": {"planes": {"initial": 0}}}, "rates.planes.initial: 0 is out of range; it must be a number from 1e"),
        ({"rates": {"planes": {"initial": float("nan")}}}, "initial: must be a number from 1e-12 to 1000000, not nan"),
        ({"rates": {"planes": {"initial": float("-inf")}}}, "must be a number from 1e-12 to 1000000, not -inf"),
        ({"rates": {"planes": {"initial": 10**400}}}, "rates.planes.initial: 1000"),
        ({"rates": {"planes": 0.1}}, "rates.planes: is a section, with the keys initial, final; it cannot be the numb"),
        ({"rates": [1]}, "rates: is a section, with the keys planes, heads; it cannot be a list"),
        ({"rates.planes": {}}, 'run.toml: "rates.planes": unknown key; '),
        ({"motion": False}, 'motion: is "none" or a section of keys; it cannot be false'),
        ({"motion": "on"}, 'motion: is "none" or a section of keys; it cannot be the text "on"'),
        ({"motion": {"tracks": "boxs"}}, 'motion.tracks: the text "boxs" must be one of auto, boxes; did you mean'),
        ({"color": "gren"}, "color: the text \"gren\" must be one of red, green; did you mean green?"),
        ({"color": {"red": 1}}, "color: a table must be one of red, green"),
        ({"preset": 3}, "preset: the number 3 must be a text"),
        ({"limit": 6}, 'limit: 6 is out of range; it must be a number from 0 to 5'),
        ({"limit": "off"}, 'limit: the text "off" must be a number from 0 to 5'),
        ({"rows": []}, "rows: is empty; name at least one"),
        ({"rows": [1, 0]}, "rows[1]: 0 is out of range"),
        ({"rows": 3}, "rows: the number 3 must be a list of one or more"),
        ({"box": [0.1]}, "box: a list of 1 must be a list of 2, each a number from 0 to 1"),
        ({"window": {"start": 7}}, "run.toml: window: start is 7, after until, which is 5"),
    ],
)  # fmt: skip
def test_what_is_not_allowed_is_refused_with_what_is(table: dict[str, Any], says: str) -> None:
    assert says in refusal(table)


def test_a_section_without_defaults_asks_for_what_is_missing() -> None:
    @dataclass(frozen=True)
    class Outer:
        decay: Decay | None = None

    # A name that annotations of a local class can find.
    Outer.__annotations__["decay"] = Decay | None
    with pytest.raises(InputError, match=r"decay\.final: missing; it must be a number from 1e"):
        changed(Outer(), {"decay": {"initial": 1.0}}, str)


def test_every_key_has_its_path() -> None:
    assert list(keys(Tree)) == [
        *("preset", "iterations", "is_deep", "color", "rows", "box", "limit", "motion.tracks", "motion.turn"),
        *("rates.planes.initial", "rates.planes.final", "rates.heads.initial", "rates.heads.final"),
        *("window.start", "window.until"),
    ]


def drawn(kind: Any, rng: random.Random) -> Any:
    """A value that an annotation allows."""
    if get_origin(kind) is Annotated:
        inner, rule = get_args(kind)
        if isinstance(rule, NameIn):
            return rng.choice(rule.names())
        value = rng.uniform(max(rule.least, -1e9), min(rule.most, 1e9)) or 1.0
        return max(round(value), 1) if inner is int else rng.choice([value, value * 1e-9 or 1.0])
    if type(None) in get_args(kind):
        return None if rng.random() < 0.3 else drawn(get_args(kind)[0], rng)
    if dataclasses.is_dataclass(kind):
        if kind is Window:
            return Window(*sorted(rng.sample(range(1, 100), 2)))
        hints = get_type_hints(kind, include_extras=True)
        return kind(**{f.name: drawn(hints[f.name], rng) for f in dataclasses.fields(kind)})
    if get_origin(kind) is tuple:
        items = get_args(kind)
        return tuple(drawn(items[0], rng) for _ in range(rng.randint(1, 4) if items[-1] is Ellipsis else len(items)))
    if get_origin(kind) is Literal:
        return rng.choice(get_args(kind))
    return rng.random() < 0.5 if kind is bool else "".join(rng.choice('a"\\\n\t\x7f\x01é𝄞 #=') for _ in range(6))


def test_what_is_written_is_read_back_as_it_was(tmp_path: Path) -> None:
    rng = random.Random(0)
    path = tmp_path / "settings.toml"
    for _ in range(200):
        tree = drawn(Tree, rng)
        path.write_text(as_toml(tree, "a tree"), encoding="utf-8")
        assert Given.by(path).applied(drawn(Tree, rng)) == tree


def test_names_that_are_no_settings_are_written_first(tmp_path: Path) -> None:
    path = tmp_path / "settings.toml"
    path.write_text(as_toml(BASE, "of a run", {"method": "x"}))
    assert path.read_text().startswith('# of a run\nmethod = "x"\npreset = "quick"\n')
    given = Given.by(path)
    assert given.chosen("method", ["x", "y"], "y") == "x"
    assert given.applied(BASE, chosen=["method"]) == BASE
