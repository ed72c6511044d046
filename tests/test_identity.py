"""Identities: how they are computed, and that both writers of captures agree on it."""

import hashlib
import json

import pytest

from aa4d.capture.content import content_of
from aa4d.identity import Identity, digest_of, identity_of
from synth.identity import capture_identity

INDEX = {"name": "Straße", "fps": 12.0, "frames": [{"t": 0.1, "viewmat": [[1.0, -1e-17]]}], "generator": {"seed": 1}}
FILES = {"frames/000000.png": "ab", "points.ply": "cd"}


def test_a_digest_is_that_of_sorted_json_without_spaces() -> None:
    text = '{"a":[1.0,1e-17,null],"b":"\\u00df"}'
    assert digest_of({"b": "ß", "a": [1.0, 1e-17, None]}) == hashlib.sha256(text.encode()).hexdigest()


def test_synth_and_aa4d_give_one_capture_one_identity() -> None:
    written = capture_identity(INDEX, FILES, {"plan": "ef"})
    read_back = json.loads(json.dumps(INDEX | {"identity": written}, indent=1))
    identity = Identity("capture", content_of(read_back, FILES), {"plan": "ef"})
    assert identity.as_json() == written
    assert identity_of(written) == identity


def test_the_digest_depends_on_all_parts_and_not_on_their_order() -> None:
    one = Identity("model", "a", {"run": "b", "capture": "c"})
    assert Identity("model", "a", {"capture": "c", "run": "b"}).digest() == one.digest()
    others = (
        Identity("run", "a", one.made_from),
        Identity("model", "b", one.made_from),
        Identity("model", "a", {"run": "b"}),
    )
    assert len({one.digest(), *(other.digest() for other in others)}) == 4


@pytest.mark.parametrize(
    "value",
    [
        None,
        [],
        "capture",
        {},
        {"kind": "capture", "version": 2, "content": "a", "made_from": {}},
        {"kind": "capture", "version": 1, "content": 3, "made_from": {}},
        {"kind": "capture", "version": 1, "content": "a", "made_from": {"plan": []}},
        {"kind": "capture", "version": 1, "content": "a", "made_from": 3},
    ],
)
def test_a_damaged_identity_counts_as_none(value: object) -> None:
    assert identity_of(value) is None
