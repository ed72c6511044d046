"""Every hard case keeps its bound; `aa4d stress` prints the same cases as a table."""

from importlib import import_module

import pytest

from aa4d.stress.cases import HardCase
from tests.hard_cases import PARTS

CASES = [
    pytest.param(case, id=f"{part}-{case.name}", marks=[pytest.mark.slow] if case.is_slow else [])
    for part in PARTS
    for case in import_module(f"tests.hard_cases.{part}").PART.cases
]


@pytest.mark.parametrize("case", CASES)
def test_hard_case_keeps_its_bound(case: HardCase) -> None:
    assert case.run() <= case.bound
