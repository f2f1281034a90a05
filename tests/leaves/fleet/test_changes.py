"""What changed between two runs: nothing between equal ones, no parameter by chance, everything that really did."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from truepose.identification.leaves.fleet.changes import Change, compared, limit, paired
from truepose.identification.leaves.fleet.record import Record


def record(
    name: str, rng: np.random.Generator | None = None, verdict: str = "adequate", key: str = "k"
) -> Record:
    shift = np.zeros(20) if rng is None else rng.standard_normal(20)
    parameters = {f"p{k}": (float(10.0 + 0.1 * shift[k]), 0.1) for k in range(20)}
    return Record(name, key, "done", "", {"verdict": verdict, "findings": []}, parameters)


NAMES = st.sets(st.text("abc", min_size=1, max_size=3))


@given(NAMES, NAMES)
def test_every_machine_is_paired_once(before: set[str], after: set[str]) -> None:
    pairs = list(paired((record(n) for n in sorted(before)), (record(n) for n in sorted(after))))
    assert [(old or new).name for old, new in pairs if old or new] == sorted(before | after)  # type: ignore[union-attr]
    assert {old.name for old, _ in pairs if old} == before and {new.name for _, new in pairs if new} == after
    assert all(old.name == new.name for old, new in pairs if old and new)
    changes = compared((record(n) for n in sorted(before)), (record(n) for n in sorted(after)))
    assert set(changes.new) == after - before and set(changes.gone) == before - after
    assert not changes.said and not changes.moved and changes.again == 0
    assert changes.any == (before != after)


def test_chance_moves_nothing() -> None:
    """Twice measured with the stated 1-sigma: in 200 runs of 500 parameters about 10 say that one has moved."""
    false = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        before = [record(f"m{k:02d}", rng, key="a") for k in range(25)]
        after = [record(f"m{k:02d}", rng, key="b") for k in range(25)]
        changes = compared(before, after)
        assert changes.compared == 500 and changes.again == 25
        false += bool(changes.moved)
    assert false <= 20  # binomial of 200 and 0.05: more than 20 once in a thousand


def test_what_moved_is_told_with_its_size() -> None:
    before, after = record("m", key="a"), record("m", key="b")
    moved = replace(after, parameters={**after.parameters, "p3": (11.0, 0.1), "new": (0.0, 1.0)})
    changes = compared([before], [moved])
    assert [(one.parameter, one.change) for one in changes.moved] == [("p3", 1.0)]
    assert changes.moved[0].sigma == pytest.approx(1.0 / (0.1 * np.sqrt(2.0)))
    assert changes.compared == 20


def test_the_limit_grows_with_the_number_compared() -> None:
    limits = [limit(count) for count in (0, 1, 10, 10**3, 10**6)]
    assert limits == sorted(limits) and limits[0] == 3.0
    assert 2 * 10**6 * norm.sf(limits[-1]) == pytest.approx(0.05)


def test_words_that_changed() -> None:
    found = [{"effect": "backlash", "place": ["q2"]}, {"effect": "actuator-scale", "place": ["q1", "q2"]}]
    before, after = record("m"), record("m", verdict="missing-physics", key="b")
    after = replace(after, figures={**after.figures, "findings": found})
    assert compared([before], [after]).said == (
        Change("m", "verdict", "adequate", "missing-physics"),
        Change("m", "findings", "", "actuator-scale at q1 + q2; backlash at q2"),
    )
    failed = Record("m", "c", "failed", "no such column")
    assert compared([after], [failed]).said == (Change("m", "status", "done", "failed"),)
