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
    """Annotation for any number of names, each once, in the order in which they are given."""
    names = tuple(registered(module, registry))
    return PrimitiveConstructorSpec(
        nargs="*",
        metavar="{" + ",".join(names) + "} ...",
        instance_from_str=lambda given: tuple(dict.fromkeys(_checked(name, names, option) for name in given)),
        is_instance=lambda value: value is None or isinstance(value, tuple),
        str_from_instance=lambda value: list(value or (otherwise,)),
    )


def list_of(module: str, registry: str, option: str) -> PrimitiveConstructorSpec[tuple[str, ...] | None]:
    """Annotation for names in one argument with commas between them, each once; None for "all"."""
    names = tuple(registered(module, registry))

    def read(given: list[str]) -> tuple[str, ...] | None:
        if given[0] == "all":
            return None
        return tuple(dict.fromkeys(_checked(name, ("all", *names), option) for name in given[0].split(",")))

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="all|" + ",".join(names),
        instance_from_str=read,
        is_instance=lambda value: value is None or isinstance(value, tuple),
        str_from_instance=lambda value: ["all" if value is None else ",".join(value)],
    )


def described(module: str, registry: str, attribute: str) -> str:
    """Descriptions of a registry's entries, their `attribute`, as one line of help."""
    entries = import_module(module).__dict__[registry].items()
    return " ".join(f"{name}: {getattr(entry, attribute)}." for name, entry in entries)


def _checked(given: str, names: tuple[str, ...], option: str) -> str:
    if given not in names:
        raise InputError(f"{option} {shown(given)}: must be {one_of(names, given)}")
    return given
