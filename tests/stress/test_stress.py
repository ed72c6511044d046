"""The table's runner and the search: what fails is seen, and what is found is as small as can be."""

from __future__ import annotations

import math

import pytest

from aa4d.stress.cases import HardCase, Part, Search
from aa4d.stress.page import as_markdown, row, summary
from aa4d.stress.runner import run_case, run_cases
from aa4d.stress.search import run_search, search_for


def case(error: float | Exception, bound: float = 1e-6) -> HardCase:
    def run() -> float:
        if isinstance(error, Exception):
            raise error
        return error

    return HardCase("some part", "a | b", "why", "what", bound, run)


@pytest.mark.parametrize(
    ("error", "passes"),
    [(0.0, True), (1e-6, True), (2e-6, False), (math.nan, False), (math.inf, False), (ValueError("no"), False)],
)
def test_a_case_passes_within_its_bound_alone(error: float | Exception, passes: bool) -> None:
    outcome = run_case(case(error))
    assert outcome.passes == passes
    assert ("ValueError: no" in row(outcome)) == isinstance(error, ValueError)


def test_the_page_has_a_row_for_each_case() -> None:
    told: list[tuple[int, int]] = []
    outcomes = list(run_cases([case(0.0), case(1.0)], lambda done, total: told.append((done, total))))
    page = as_markdown(outcomes, {"some part": "Some part"})
    assert told == [(0, 2), (1, 2), (2, 2)]
    assert summary(outcomes).startswith("2 cases, 1 failed")
    assert "## Some part" in page
    assert page.count(r"| a \| b | ") == 2
    assert page.count("| why | what | ") == 1


def test_each_value_is_a_case_of_its_own() -> None:
    part = Part("some part")

    @part.case(why="why", done="what", each={"one": 1.0, "two": 2.0})
    def an_error(value: float) -> float:
        return value

    assert [c.name for c in part.cases] == ["an error: one", "an error: two"]
    assert [c.run() for c in part.cases] == [1.0, 2.0]


def test_the_search_shrinks_what_it_finds_and_stays_quiet_where_nothing_is() -> None:
    st = pytest.importorskip("hypothesis.strategies")
    found = run_search(Search("p", "n", lambda: st.integers(0, 10**6), 0.0, lambda x: float(x >= 1000)), 0, 5.0)
    assert (found.example, found.worst) == (1000, 1.0)
    quiet = run_search(Search("p", "n", lambda: st.integers(0, 10), 0.0, lambda _: 0.0), 0, 0.1)
    assert quiet.example is None
    assert quiet.tried > 0
    raised = run_search(Search("p", "n", lambda: st.integers(0, 10), 0.0, lambda x: 1 / (x - x)), 0, 1.0)
    assert raised.example == 0
    assert "ZeroDivisionError" in raised.reason


def test_the_search_tells_how_much_of_its_time_is_over() -> None:
    st = pytest.importorskip("hypothesis.strategies")
    quiet = [Search("p", name, lambda: st.integers(0, 10), 0.0, lambda _: 0.0) for name in ("a", "b")]
    told: list[tuple[int, int]] = []
    assert len(list(search_for(quiet, 0, 2.4, lambda _: None, lambda *step: told.append(step)))) == 2
    assert {total for _, total in told} == {3}
    passed = [done for done, _ in told]
    assert passed == sorted(passed)
    assert set(passed) == {0, 1, 2, 3}
