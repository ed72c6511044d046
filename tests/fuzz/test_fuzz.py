"""Two hundred damaged files for every reader; `make fuzz` has ten thousand."""

import pytest

from tests.fuzz.attack import attack
from tests.fuzz.readers import READERS, Reader


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_a_damaged_file_is_taken_or_refused_in_one_sentence(reader: Reader) -> None:
    assert list(attack(reader, range(200))) == []
