"""A refusal is one sentence, whatever the value that it quotes."""

import pytest

from aa4d.errors import LONGEST, InputError
from addon.container import ModelFileError
from synth.errors import InputError as SceneError


@pytest.mark.parametrize("kind", [InputError, SceneError, ModelFileError])
def test_an_endless_value_leaves_where_it_is_and_what_to_do(kind: type[Exception]) -> None:
    said = str(kind(f"scene.toml: name: {'x' * 10**6} is too\nlong; choose a shorter one"))
    assert said.startswith("scene.toml: name: x")
    assert said.endswith("x is too long; choose a shorter one")
    assert len(said) <= LONGEST + len(" ... ")


@pytest.mark.parametrize("kind", [InputError, SceneError, ModelFileError])
def test_a_sentence_is_left_alone(kind: type[Exception]) -> None:
    assert str(kind('a.toml: key  "b": missing')) == 'a.toml: key  "b": missing'
