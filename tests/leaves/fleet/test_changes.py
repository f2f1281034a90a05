"""What changed between two runs: nothing between equal ones, no parameter by chance, everything that really did."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from truepose.identification.leaves.fleet.record import Change, Record, compare, sigma_limit


def record(
    name: str, rng: np.random.Generator | None = None, verdict: str = "adequate", key: str = "k"
) -> Record:
    shift = np.zeros(20) if rng is None else rng.standard_normal(20)
    parameters = {f"p{k}": (float(10.0 + 0.1 * shift[k]), 0.1) for k in range(20)}
    figures = {"verdict": verdict, "findings": ""}
    return Record(name=name, key=key, status="done", figures=figures, parameters=parameters)


def by_name(*records: Record) -> dict[str, Record]:
    return {one.name: one for one in records}


NAMES = st.sets(st.text("abc", min_size=1, max_size=3))


@given(NAMES, NAMES)
def test_machines_are_new_gone_or_as_they_were(before: set[str], after: set[str]) -> None:
    changes = compare(by_name(*map(record, before)), by_name(*map(record, after)))
    assert set(changes.new) == after - before and set(changes.gone) == before - after
    assert not changes.said and not changes.moved and changes.again == 0
    assert changes.any == (before != after)


def test_chance_moves_nothing() -> None:
    """Twice measured with the stated 1-sigma: in 200 runs of 500 parameters about 10 say that one has moved."""
    false = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        before, after = (
            by_name(*(record(f"m{k:02d}", rng, key=key) for k in range(25))) for key in ("a", "b")
        )
        changes = compare(before, after)
        assert changes.compared == 500 and changes.again == 25
        false += bool(changes.moved)
    assert false <= 20  # binomial of 200 and 0.05: more than 20 once in a thousand


def test_what_moved_is_told_with_its_size() -> None:
    before, after = record("m", key="a"), record("m", key="b")
    moved = after.model_copy(
        update={"parameters": {**after.parameters, "p3": (11.0, 0.1), "new": (0.0, 1.0)}}
    )
    changes = compare(by_name(before), by_name(moved))
    assert [(one.parameter, one.change) for one in changes.moved] == [("p3", 1.0)]
    assert changes.moved[0].sigma == pytest.approx(1.0 / (0.1 * np.sqrt(2.0)))
    assert changes.compared == 20


def test_the_limit_grows_with_the_number_compared() -> None:
    limits = [sigma_limit(count) for count in (0, 1, 10, 10**3, 10**6)]
    assert limits == sorted(limits) and limits[0] == 3.0
    assert 2 * 10**6 * norm.sf(limits[-1]) == pytest.approx(0.05)


def test_words_that_changed() -> None:
    before, after = record("m"), record("m", verdict="missing-physics", key="b")
    after.figures["findings"] = "backlash at q2"
    assert compare(by_name(before), by_name(after)).said == (
        Change("m", "verdict", "adequate", "missing-physics"),
        Change("m", "findings", "", "backlash at q2"),
    )
    failed = Record(name="m", key="c", status="failed", why="no such column")
    assert compare(by_name(after), by_name(failed)).said == (Change("m", "status", "done", "failed"),)
