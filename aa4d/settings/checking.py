"""Tables of keys checked against frozen dataclasses: the one place of aa4d that says yes or no to a setting."""

from __future__ import annotations

import dataclasses
import difflib
import json
import math
import types
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from aa4d.errors import InputError
from aa4d.settings.allowed import NameIn, Range

T = TypeVar("T")
NONE = "none"  # TOML has no word for a setting that is off
LARGEST = 2**63 - 1  # of a whole number: TOML's and torch's own

# From a key such as "loss.dssim" to who gave it: "run.toml: loss.dssim" or "--set loss.dssim".
Place = Callable[[str], str]


def changed(base: T, table: Mapping[str, Any], place: Place, withheld: Collection[str] = ()) -> T:
    """A copy of the dataclass instance `base` with what `table` says in place of its own.

    A nested dataclass is a table of its keys, of which those left out stay. An optional one is off with "none", and a
    table of any of its keys, or an empty one, turns it on. Ranges and names are declared in annotations
    (aa4d/settings/allowed.py); what a class refuses in `__post_init__` with a ValueError is refused here. `BESIDE` of a
    class: keys that its caller takes out of the table first, named with those that are allowed. `withheld`: keys that
    its caller refuses, which are not.

    Raises:
        InputError: an unknown key, a wrong type, or a value that is not allowed: who gave it, which, what is allowed.
    """
    return _Checker(type(base), place, withheld).record(type(base), base, table, "")


@dataclass(frozen=True)
class _Checker:
    root: type
    place: Place
    withheld: Collection[str] = ()  # of the keys at the top

    def fail(self, where: str, message: str) -> InputError:
        return InputError(f"{self.place(where)}: {message}")

    def record(self, cls: type[T], base: T | None, table: Any, where: str) -> T:
        """`base`, or where it is None a new instance of `cls`, with what `table` says."""
        fields = {f.name: f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]
        if not isinstance(table, Mapping):
            raise self.fail(where, f"is a section, with the keys {', '.join(fields)}; it cannot be {describe(table)}")
        hints = get_type_hints(cls, include_extras=True)
        prefix = f"{where}." if where else ""
        values = {} if base is None else {name: getattr(base, name) for name in fields}
        for name, value in table.items():
            if name not in fields:
                here = [*fields, *getattr(cls, "BESIDE", ())]
                here = [key for key in here if where or key not in self.withheld]
                meant = self.meant(name, here, prefix)
                hint = f"did you mean {meant}? Allowed" if meant else "allowed"
                raise self.fail(prefix + _quoted(name), f"unknown key; {hint} here: {', '.join(here)}")
            values[name] = self.value(hints[name], values.get(name), value, prefix + name)
        for name, field in fields.items():
            missing = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
            if missing and name not in values:
                raise self.fail(prefix + name, f"missing; it must be {expected(hints[name])}")
        try:
            return cls(**values)
        except ValueError as error:
            raise self.fail(where or ", ".join(table), str(error)) from None

    def meant(self, name: str, here: list[str], prefix: str) -> str | None:
        """The nearest key of this section, else the nearest of any other."""
        near = nearest(name, here)
        if near is not None:
            return prefix + near
        paths = list(keys(self.root))
        near = nearest(name, [path.rpartition(".")[2] for path in paths])
        return next((path for path in paths if path.rpartition(".")[2] == near), None)

    def value(self, kind: Any, base: Any, value: Any, where: str, allowed: tuple[Any, ...] = ()) -> Any:
        """One value of a table as the type `kind`."""
        if get_origin(kind) is Annotated:
            inner, *more = get_args(kind)
            return self.value(inner, base, value, where, (*allowed, *more))
        if is_optional(kind):
            if value == NONE:
                return None
            inner = without_none(kind)
            if dataclasses.is_dataclass(inner) and not isinstance(value, Mapping):
                raise self.fail(where, f'is "{NONE}" or a section of keys; it cannot be {describe(value)}')
            return self.value(inner, base, value, where, allowed)
        if dataclasses.is_dataclass(kind):
            return self.record(kind if base is None else type(base), base, value, where)  # type: ignore[arg-type]
        if get_origin(kind) is tuple:
            return self.sequence(kind, value, where, allowed)
        names = names_of(kind, allowed)
        if names is not None:
            if not isinstance(value, str) or value not in names:
                raise self.fail(where, f"{describe(value)} must be {one_of(names, value)}")
            return value
        if not isinstance(value, (int, float) if kind is float else kind) or (
            isinstance(value, bool) and kind is not bool
        ):
            raise self.fail(where, f"{describe(value)} must be {expected(kind, allowed)}")
        if kind is float and isinstance(value, float) and not math.isfinite(value):
            raise self.fail(where, f"must be {expected(kind, allowed)}, not {value}")
        if kind in (int, float) and not _is_within(kind, value, allowed):
            raise self.fail(where, f"{_short(str(value))} is out of range; it must be {expected(kind, allowed)}")
        return float(value) if kind is float else value

    def sequence(self, kind: Any, value: Any, where: str, allowed: tuple[Any, ...]) -> tuple[Any, ...]:
        items = get_args(kind)
        is_open = items[-1] is Ellipsis
        if is_open and value == []:
            raise self.fail(where, "is empty; name at least one")
        if not isinstance(value, list) or not (is_open or len(value) == len(items)):
            what = f"a list of {len(value)}" if isinstance(value, list) else describe(value)
            raise self.fail(where, f"{what} must be {expected(kind, allowed)}")
        kinds = items[:1] * len(value) if is_open else items
        return tuple(
            self.value(item_kind, None, item, f"{where}[{i}]", allowed)
            for i, (item_kind, item) in enumerate(zip(kinds, value, strict=True))
        )


def _is_within(kind: type, value: float, allowed: tuple[Any, ...]) -> bool:
    try:
        finite = math.isfinite(float(value))
    except OverflowError:  # a whole number beyond float64
        return False
    bounds = (limit for limit in allowed if isinstance(limit, Range))
    return finite and (kind is float or abs(value) <= LARGEST) and all(limit.holds(value) for limit in bounds)


def keys(cls: type, prefix: str = "") -> Iterator[str]:
    """The dotted path of every value of the tree that begins at the dataclass `cls`."""
    hints = get_type_hints(cls)
    for field in dataclasses.fields(cls):
        name, inner = field.name, without_none(hints[field.name])
        if dataclasses.is_dataclass(inner):
            yield from keys(inner, f"{prefix}{name}.")  # type: ignore[arg-type]
        else:
            yield prefix + name


def is_optional(kind: Any) -> bool:
    return get_origin(kind) in (Union, types.UnionType) and types.NoneType in get_args(kind)


def without_none(kind: Any) -> Any:
    if is_optional(kind):
        return next(option for option in get_args(kind) if option is not types.NoneType)
    return kind


def names_of(kind: Any, allowed: tuple[Any, ...]) -> tuple[str, ...] | None:
    """The texts that alone are allowed, or None where there is no such list."""
    if get_origin(kind) is Literal:
        return get_args(kind)
    return next((rule.names() for rule in allowed if isinstance(rule, NameIn)), None)


def nearest(name: str, names: Iterable[str]) -> str | None:
    near = difflib.get_close_matches(name, list(names), n=1, cutoff=0.6)
    return near[0] if near else None


def repeated(values: Iterable[Any]) -> str | None:
    """A sentence on the first entry that a list without repeats has twice; None where all differ."""
    seen: list[Any] = []
    for value in values:
        if value in seen:
            return f"{describe(value)} stands there twice; name each once"
        seen.append(value)
    return None


def one_of(names: Iterable[str], given: Any = None) -> str:
    """The choice in words, and where `given` is nearly one of them, which."""
    listed = list(names)
    near = nearest(given, listed) if isinstance(given, str) else None
    choice = f"one of {', '.join(listed)}" if len(listed) > 1 else ", ".join(listed)
    return f"{choice}; did you mean {near}?" if near else choice


def expected(kind: Any, allowed: tuple[Any, ...] = ()) -> str:
    """What a key would accept, in words."""
    if get_origin(kind) is Annotated:
        inner, *more = get_args(kind)
        return expected(inner, (*allowed, *more))
    if is_optional(kind):
        return f'{expected(without_none(kind), allowed)}, or "{NONE}"'
    if dataclasses.is_dataclass(kind):
        return f"a table of {', '.join(field.name for field in dataclasses.fields(kind))}"
    names = names_of(kind, allowed)
    if names is not None and get_origin(kind) is not tuple:
        return one_of(names)
    if get_origin(kind) is tuple:
        items = get_args(kind)
        many = "one or more" if items[-1] is Ellipsis else str(len(items))
        return f"a list of {many}, each {expected(items[0], allowed)}"
    words = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}[kind]
    limits = " and ".join(str(limit) for limit in allowed if isinstance(limit, Range) and kind in (int, float))
    return f"{words} {limits}".rstrip()


def describe(value: Any) -> str:
    """What a value is, in words."""
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, list):
        return "a list"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return f"the number {_short(str(value))}"
    if isinstance(value, str):
        return f"the text {_short(json.dumps(value, ensure_ascii=False))}"
    return f"the {type(value).__name__} {value}"  # TOML's dates and times


def shown(key: str) -> str:
    """What should have been a key, as a sentence can hold it."""
    return _short(key if key.isprintable() and key else json.dumps(key))


def _quoted(key: str) -> str:
    """A key of a file, in quotes where it is no plain word: "loss.dssim" is no dssim of loss."""
    return shown(key) if "." not in key else json.dumps(key)


def _short(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."
