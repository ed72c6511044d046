"""Tables of a TOML file checked against frozen dataclasses: the one place that says yes or no to a value.

Every field is a key of the file and is declared with `key`: its meaning, unit, range and default. The reference page
(`synth/reference.py`) is written from the same declarations, so that the two cannot disagree.
"""

import dataclasses
import difflib
import math
import types
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from synth.errors import InputError

REQUIRED = dataclasses.MISSING


def key(
    meaning: str,
    *,
    unit: str = "",
    range: tuple[float, float] | None = None,  # noqa: A002 - the word of the reference page
    default: Any = REQUIRED,
    kinds: Mapping[str, type] | None = None,
    why: str = "",
) -> Any:
    """A field of a checked dataclass.

    `range` bounds the value (or each number in it). `kinds` makes the key a table whose own key `kind` chooses the
    dataclass that it is checked against. `why` is told to whoever leaves the range.
    """
    metadata = {"meaning": meaning, "unit": unit, "range": range, "kinds": kinds, "why": why}
    return field(default=default, metadata=metadata)


def check(cls: type, table: Any, where: str, source: str) -> Any:
    """`table` as an instance of `cls`; `where` is its key in the file `source`, "" at the top.

    Raises:
        InputError: an unknown or missing key, a wrong type, a value out of range; one sentence that names the key.
    """
    return _Checker(source).record(cls, table, where)


@dataclass(frozen=True)
class _Checker:
    source: str

    def fail(self, where: str, message: str) -> InputError:
        return InputError(f"{self.source}: {where}: {message}.")

    def record(self, cls: type, table: Any, where: str) -> Any:
        """A table of the file as an instance of `cls`."""
        if not isinstance(table, dict):
            raise self.fail(where, f"must be a table of keys, not {describe(table)}")
        fields = {f.name: f for f in dataclasses.fields(cls)}
        hints = get_type_hints(cls)
        prefix = f"{where}." if where else ""
        for name in table:
            if name not in fields:
                near = difflib.get_close_matches(name, fields, n=1, cutoff=0.5)
                hint = f"did you mean {near[0]!r}? " if near else ""
                raise self.fail(prefix + name, f"unknown key; {hint}allowed here: {', '.join(fields)}")
        values = {}
        for name, spec in fields.items():
            if name in table:
                values[name] = self.field(hints[name], spec.metadata, table[name], prefix + name)
            elif spec.default is REQUIRED and spec.default_factory is REQUIRED:
                raise self.fail(prefix + name, f"missing; it must be {expected(hints[name], spec.metadata)}")
        return cls(**values)

    def field(self, kind: Any, metadata: Mapping[str, Any], value: Any, where: str) -> Any:
        kinds = metadata.get("kinds")
        if kinds is None:
            return self.value(kind, value, where, metadata)
        if not isinstance(value, dict):
            raise self.fail(where, f"must be a table of keys, not {describe(value)}")
        if "kind" not in value:
            raise self.fail(f"{where}.kind", f"missing; it must be one of {', '.join(map(repr, kinds))}")
        chosen = value["kind"]
        if not isinstance(chosen, str) or chosen not in kinds:
            near = difflib.get_close_matches(str(chosen), kinds, n=1)
            hint = f", did you mean {near[0]!r}?" if near else "."
            message = f"{describe(chosen)} must be one of {', '.join(map(repr, kinds))}{hint}"
            raise InputError(f"{self.source}: {where}.kind: {message}")
        return self.record(kinds[chosen], value, where)

    def value(self, kind: Any, value: Any, where: str, metadata: Mapping[str, Any]) -> Any:
        """One value of the file as the type `kind`."""
        kind = without_none(kind)
        wanted = expected(kind, metadata)
        limits = metadata.get("range")
        if dataclasses.is_dataclass(kind):
            return self.record(kind, value, where)  # type: ignore[arg-type]
        if get_origin(kind) is dict:
            return self.tables(value, where)
        if get_origin(kind) is tuple:
            return self.sequence(kind, value, where, metadata)
        if get_origin(kind) is Literal:
            if not isinstance(value, str) or value not in get_args(kind):
                near = difflib.get_close_matches(str(value), get_args(kind), n=1)
                hint = f", did you mean {near[0]!r}?" if near else "."
                raise InputError(f"{self.source}: {where}: {describe(value)} must be {wanted}{hint}")
            return value
        accepted = (int, float) if kind is float else (kind,)
        if not isinstance(value, accepted) or (isinstance(value, bool) and kind is not bool):
            raise self.fail(where, f"{describe(value)} must be {wanted}")
        try:
            finite = not isinstance(value, (int, float)) or math.isfinite(value)
        except OverflowError:  # a whole number beyond float64
            finite = False
        why = f" ({metadata['why']})" if metadata.get("why") else ""
        if isinstance(value, float) and not finite:
            raise self.fail(where, f"must be {wanted}, not {value}{why}")
        if not finite or (limits and not limits[0] <= value <= limits[1]):
            raise self.fail(where, f"{value} is out of range, it must be {wanted}{why}")
        return float(value) if kind is float else value

    def tables(self, value: Any, where: str) -> dict[str, Any]:
        """Tables by name, checked further by whoever owns them."""
        if not isinstance(value, dict):
            raise self.fail(where, f"{describe(value)} must be tables of keys")
        for name, table in value.items():
            if not isinstance(table, dict):
                raise self.fail(f"{where}.{name}", f"{describe(table)} must be a table of keys")
        return value

    def sequence(self, kind: Any, value: Any, where: str, metadata: Mapping[str, Any]) -> tuple[Any, ...]:
        items = get_args(kind)
        if not isinstance(value, list):
            raise self.fail(where, f"{describe(value)} must be {expected(kind, {})}")
        if items[-1] is Ellipsis:
            return tuple(self.value(items[0], item, f"{where}[{i}]", metadata) for i, item in enumerate(value))
        if len(value) != len(items):
            raise self.fail(where, f"a list of {len(value)} must be {expected(kind, {})}")
        return tuple(self.value(items[i], item, f"{where}[{i}]", metadata) for i, item in enumerate(value))


def describe(value: Any) -> str:
    """What a value of the file is, in words."""
    if isinstance(value, bool):
        return "true" if value else "false"  # as the file has it
    names = {str: "the text", int: "the number", float: "the number"}
    return f"{names[type(value)]} {value!r}" if type(value) in names else f"a {type(value).__name__}"


def expected(kind: Any, metadata: Mapping[str, Any]) -> str:
    """What a key would accept, in words."""
    kind = without_none(kind)
    if metadata.get("kinds") or dataclasses.is_dataclass(kind) or get_origin(kind) is dict:
        return "a table of keys"
    if get_origin(kind) is Literal:
        return "one of " + ", ".join(repr(option) for option in get_args(kind))
    if get_origin(kind) is tuple:
        items = get_args(kind)
        item = items[0]
        what = "numbers"
        if get_origin(item) is tuple:
            what = "lists"
        elif dataclasses.is_dataclass(item):
            what = "tables"
        elif item is str or get_origin(item) is Literal:
            what = "texts"
        return f"a list of {what}" if items[-1] is Ellipsis else f"a list of {len(items)} {what}"
    words = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}[kind]
    if metadata.get("range"):
        words += " from {:g} to {:g}".format(*metadata["range"])
    return words


def without_none(kind: Any) -> Any:
    if get_origin(kind) in (Union, types.UnionType):
        return next(option for option in get_args(kind) if option is not types.NoneType)
    return kind
