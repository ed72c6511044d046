"""Options whose choices are the names of a registry: what is entered there is found on the command line.

Such an annotation is evaluated, and so the registry imported, when the command that has it is parsed; no other command
waits for that.
"""

from __future__ import annotations

from importlib import import_module

from tyro.constructors import PrimitiveConstructorSpec

from aa4d.errors import InputError
from aa4d.settings.allowed import registered
from aa4d.settings.checking import one_of, shown

ALL = "all"


def name_in(module: str, registry: str, option: str, otherwise: str = "") -> PrimitiveConstructorSpec[str | None]:
    """For an argument that is one of the names in `registry` of `module`, or None where it is not given.

    Args:
        option: what the argument is called on the command line.
        otherwise: what help says of the default where that is None.
    """
    names = tuple(registered(module, registry))
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="{" + ",".join(names) + "}",
        instance_from_str=lambda given: _checked(given[0], names, option),
        is_instance=lambda value: value is None or isinstance(value, str),
        str_from_instance=lambda value: [value or otherwise],
    )


def names_in(
    module: str, registry: str, option: str, otherwise: str = ""
) -> PrimitiveConstructorSpec[tuple[str, ...] | None]:
    """Annotation for any number of names, with blanks or commas between them, each once, in the order in which they are
    given; where `otherwise` is "all", None for that word."""
    names = tuple(registered(module, registry))
    allowed = (ALL, *names) if otherwise == ALL else names
    return PrimitiveConstructorSpec(
        nargs="*",
        metavar="{" + ",".join(allowed) + "} ...",
        instance_from_str=lambda given: _several(given, allowed, option),
        is_instance=lambda value: value is None or isinstance(value, tuple),
        str_from_instance=lambda value: list(value or (otherwise,)),
    )


def list_of(module: str, registry: str, option: str) -> PrimitiveConstructorSpec[tuple[str, ...] | None]:
    """Annotation for names in one argument with commas, and blanks, between them, each once; None for "all"."""
    names = tuple(registered(module, registry))

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="all|" + ",".join(names),
        instance_from_str=lambda given: _several(given, (ALL, *names), option),
        is_instance=lambda value: value is None or isinstance(value, tuple),
        str_from_instance=lambda value: [ALL if value is None else ",".join(value)],
    )


def described(module: str, registry: str, attribute: str) -> str:
    """Descriptions of a registry's entries, their `attribute`, as one line of help."""
    entries = import_module(module).__dict__[registry].items()
    return " ".join(f"{name}: {getattr(entry, attribute)}." for name, entry in entries)


def _several(given: list[str], names: tuple[str, ...], option: str) -> tuple[str, ...] | None:
    """Names with commas, blanks or both between them; None where one of them is `ALL`."""
    # A comma at the end of an argument stands before the next one.
    parts = [part.strip() for text in given for part in text.strip().removesuffix(",").split(",")]
    named = dict.fromkeys(_checked(part, names, option) for part in parts)
    return None if ALL in named else tuple(named)


def _checked(given: str, names: tuple[str, ...], option: str) -> str:
    if given not in names:
        raise InputError(f"{option} {shown(given)}: must be {one_of(names, given)}")
    return given
