"""Ways to damage a file: by bytes, and by what its format means."""

from __future__ import annotations

import copy
import io
import json
import math
import random
import re
import struct
import zipfile
from typing import Any

import numpy as np

# What a JSON or TOML value may be turned into.
NASTY: list[Any] = [
    None, True, False, 0, -1, 1, 2**31, 2**63, 2**64, 10**400, -(10**400), 0.5, -0.0, 1e-320, 1e300, -1e300, math.nan,
    math.inf, -math.inf, "", "\0", "a\0b", "x" * 5000, "../../etc/passwd", "/etc/passwd", "\ud800", "日本", "1", "nan",
    [], {}, [[]], [None], {"": None}, [1, 2, 3], [[1, 0], [0, 1]], {"a": {"b": {"c": []}}},
]  # fmt: skip
ABYSS = "nested without end"  # written as such
TOML_NASTY = [
    "0", "-1", "1e400", "nan", "-inf", "99999999999999999999", "true", '""', "[]", "{}", '"\\u0000"', "[[[[]]]]",
    "1979-05-27", "0x7fffffffffffffff", '"x"', "[1, [2, [3]]]", "9" * 400, "{a = 1}", "1e-320",
]  # fmt: skip
TEXT_NASTY = [
    "", " ", "-1", "nan", "inf", "1e999", "9" * 400, "\0", ",", "\n", "0x10", "1e308", "-0", "é", "\ufeff", "x",
    "00:99:99",
]  # fmt: skip


def of_bytes(content: bytes, rng: random.Random) -> bytes:
    """A few bytes flipped, taken out, doubled or set; or the end cut off."""
    data = bytearray(content)
    for _ in range(rng.choice([1, 1, 2, 5, 30])):
        if not data:
            break
        at = rng.randrange(len(data))
        kind = rng.randrange(6)
        if kind == 0:
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            data[at] = rng.choice([0, 255, 127, 128, 48, 45, 10, 34, 123])
        elif kind == 2:
            del data[at : at + rng.choice([1, 2, 8, 100])]
        elif kind == 3:
            data[at:at] = data[at : at + rng.choice([1, 8, 100])]
        elif kind == 4:
            del data[at:]
        else:
            data[at : at + 8] = struct.pack("<Q", rng.choice([0, 1, 2**31, 2**32, 2**63, 2**64 - 1]))
    return bytes(data)


def of_value(document: Any, rng: random.Random) -> Any:
    """A JSON document with a few of its values, keys or items changed."""
    document = copy.deepcopy(document)
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        places = list(_places(document))
        if not places:
            return rng.choice(NASTY)
        holder, key = rng.choice(places)
        kind = rng.randrange(8)
        if kind <= 3:
            holder[key] = copy.deepcopy(rng.choice(NASTY))
        elif kind == 4:
            del holder[key]
        elif kind == 5:
            other, other_key = rng.choice(places)
            if key in _keys(holder) and other_key in _keys(other):
                holder[key], other[other_key] = copy.deepcopy(other[other_key]), copy.deepcopy(holder[key])
        elif kind == 6 and isinstance(holder[key], int | float) and not isinstance(holder[key], bool):
            holder[key] *= (
                rng.choice([-1, 0, 2, 10**10]) if abs(holder[key]) > 1e300 else rng.choice([-1, 1e-300, 1e10, 1e300])
            )
        elif kind == 7 and isinstance(holder, list):
            holder[key : key + 1] = [holder[key]] * rng.choice([2, 3, 50])
        else:
            holder[key] = rng.choice([[holder[key]], {"a": holder[key]}, ABYSS])
    return document


def of_json(content: bytes, rng: random.Random) -> bytes:
    if rng.random() < 0.3:
        return of_bytes(content, rng)
    return _dumped(of_value(json.loads(content), rng))


def of_toml(content: bytes, rng: random.Random) -> bytes:
    if rng.random() < 0.3:
        return of_bytes(content, rng)
    lines = content.decode().splitlines()
    for _ in range(rng.choice([1, 1, 2, 4])):
        at = rng.randrange(len(lines))
        if "=" in lines[at] and rng.random() < 0.7:
            lines[at] = lines[at].split("=")[0] + "= " + rng.choice(TOML_NASTY)
        else:
            changes = [
                [],
                [lines[at]] * 2,
                ["[" + "x." * 3000 + "y]"],
                ["[[x]]"],
                ["a = " + "[" * 3000],
                [rng.choice(lines)],
            ]
            lines[at : at + 1] = rng.choice(changes)
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def of_text(content: bytes, rng: random.Random) -> bytes:
    """Tables and subtitles: a number or a word turned into another."""
    if rng.random() < 0.3:
        return of_bytes(content, rng)
    words = re.split(r"([0-9.+-]+|[,\n\[\]: ])", content.decode())
    for _ in range(rng.choice([1, 1, 3, 10])):
        words[rng.randrange(len(words))] = rng.choice(TEXT_NASTY)
    return "".join(words).encode("utf-8", "surrogatepass")


def of_safetensors(content: bytes, rng: random.Random) -> bytes:
    """Its header, the JSON in its metadata, or the numbers of its tensors."""
    length = struct.unpack("<Q", content[:8])[0]
    header, data = json.loads(content[8 : 8 + length]), bytearray(content[8 + length :])
    kind = rng.randrange(4)
    if kind == 0:
        return of_bytes(content, rng)
    if kind == 1:
        header = of_value(header, rng)
    elif kind == 2:
        name = next(iter(header["__metadata__"]))
        inner = of_value(json.loads(header["__metadata__"][name]), rng)
        header["__metadata__"][name] = _dumped(inner).decode("utf-8", "replace")
    else:
        tensor = rng.choice([entry for name, entry in header.items() if name != "__metadata__"])
        begin, end = tensor["data_offsets"]
        for _ in range(rng.choice([1, 3, 100])):
            if end - begin >= 4:
                at = begin + 4 * rng.randrange((end - begin) // 4)
                data[at : at + 4] = struct.pack(
                    "<f", rng.choice([math.nan, math.inf, -math.inf, 1e30, -3e38, 1e-45, 7.5])
                )
        if rng.random() < 0.3 and len(tensor["shape"]) > 0:  # another shape of the same size
            tensor["shape"] = rng.choice([tensor["shape"][::-1], [math.prod(tensor["shape"])], [1, *tensor["shape"]]])
    text = _dumped(header)
    return struct.pack("<Q", len(text)) + text + bytes(data)


def of_npz(content: bytes, rng: random.Random) -> bytes:
    """An archive of arrays: bytes, or whole arrays of another shape, kind or content."""
    if rng.random() < 0.4:
        return of_bytes(content, rng)
    with np.load(io.BytesIO(content)) as file:
        arrays = {name: file[name] for name in file.files}
    name = rng.choice(list(arrays))
    old = arrays[name]
    changes: list[Any] = [
        old[:0], old.reshape(-1), old[None], old.T, np.array(5), np.zeros((0, 0, 0)), old.astype(str),
        np.full(old.shape, np.nan), np.full(old.shape, 1e300), np.full(old.shape, -1), np.full(old.shape, 2**40), None,
    ]  # fmt: skip
    change = rng.choice(changes)
    if change is None:
        del arrays[name]
    else:
        arrays[name] = change
    out = io.BytesIO()
    np.savez(out, **arrays)
    if rng.random() < 0.1:  # an entry that is no array
        with zipfile.ZipFile(out, "a") as archive:
            archive.writestr("x.npy", b"\x93NUMPY\x01\x00")
    return out.getvalue()


def _dumped(value: Any) -> bytes:
    text = json.dumps(value).replace("Infinity", "1e999").replace(json.dumps(ABYSS), "[" * 5000 + "]" * 5000)
    return text.encode("utf-8", "replace")


def _keys(holder: Any) -> Any:
    return holder if isinstance(holder, dict) else range(len(holder))


def _places(document: Any) -> Any:
    """Every (dict or list, key or index) of a document."""
    waiting = [document]
    while waiting:
        holder = waiting.pop()
        for key in _keys(holder):
            yield holder, key
            if isinstance(holder[key], dict | list):
                waiting.append(holder[key])
