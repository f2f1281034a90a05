"""Long recordings: the search begins with some of the rows and ends with all, at the same answer."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.searched_arm import ARM, SCALE
from support.simulated import machine_from, recorded
from truepose.errors import ConvergenceError
from truepose.identification.diagnosis import search as stages
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimate import estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.signatures import Signatures
from truepose.models.machine.machine import Machine

Pair = tuple[Machine, Recording]

ROWS = 1000


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Pair:
    """A small arm that moves smoothly while it is read, one row of ten for validation."""
    folder = tmp_path_factory.mktemp("arm")
    machine = machine_from(folder, ARM, "arm")
    t = np.arange(ROWS) / 20.0
    q = {"q1 [deg]": 160.0 * np.sin(0.71 * t), "q2 [deg]": 95.0 * np.sin(1.13 * t + 1.0)}
    table = pd.DataFrame(
        q | {"time": t, "role": np.where(np.arange(ROWS) % 10 == 3, "validation", "calibration")}
    )
    return machine, recorded(machine, table, SCALE)


@pytest.fixture(scope="module")
def whole(arm: Pair) -> Diagnosis:
    """The diagnosis of all rows at once."""
    return diagnose(*arm)


@given(st.integers(1, 3_000_000))
def test_stages_grow_by_the_same_step(rows: int) -> None:
    counts = [rows, *stages.fewer_rows(rows)]
    if rows <= 2 * stages.MANY:
        assert counts == [rows]
        return
    steps = [more / fewer for more, fewer in itertools.pairwise(counts)]
    assert counts[-1] == stages.MANY
    assert max(steps) <= stages.STEP * 1.001 and max(steps) / min(steps) < 1.001  # counts are whole numbers


def test_each_stage_has_one_of_the_rows_that_follow_each_other(
    arm: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, recording = arm
    assert stages.stages(machine, recording) == [recording]
    monkeypatch.setattr(stages, "MANY", 9)
    first, second, last = stages.stages(machine, recording)
    assert last is recording
    assert (len(first), len(second)) == (9, 90)
    assert not second.validation.any()
    rank = np.cumsum(~recording.validation) - 1
    np.testing.assert_array_equal(np.sort(rank[second.rows]) // 10, np.arange(90))
    assert set(first.rows) <= set(second.rows)


def test_in_stages_the_answer_is_that_of_all_rows_at_once(
    arm: Pair, whole: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, recording = arm
    monkeypatch.setattr(stages, "MANY", 100)
    said = list[str]()
    found = diagnose(machine, recording, progress=said.append)
    assert [text for text in said if "900" in text or "1,000" in text]
    assert found.verdict == whole.verdict
    assert [(f.effect, f.place) for f in found.findings] == [(f.effect, f.place) for f in whole.findings]
    assert found.findings[0].effect == "actuator-scale"
    for one, other in zip(found.findings, whole.findings, strict=True):
        assert one.probability == pytest.approx(other.probability, abs=0.02)
        for name, value in one.parameters.items():
            assert value.value == pytest.approx(other.parameters[name].value, abs=0.1 * value.std)
            assert value.std == pytest.approx(other.parameters[name].std, rel=0.02)


def test_halves_and_whole_are_summed_in_one_pass(arm: Pair, whole: Diagnosis) -> None:
    machine, recording = arm
    cat = catalogue(machine, recording)
    signatures, fit = Signatures(machine, recording, cat.candidates), whole.before
    both, halves = signatures.halved(fit)
    alone = signatures.linearise(fit)
    size = np.sqrt(np.diag(alone.gram))
    size[size == 0.0] = 1.0
    np.testing.assert_allclose(
        both.gram / size / size[:, None], alone.gram / size / size[:, None], atol=1e-12
    )
    assert (
        both.counts == alone.counts == tuple(a + b for a, b in zip(*(h.counts for h in halves), strict=True))
    )
    np.testing.assert_array_equal(both.gram, halves[0].gram + halves[1].gram)


@pytest.mark.nightly
def test_a_set_without_a_minimum_among_more_rows_is_found_again(
    arm: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first fit of a further stage that has effects fails once; the search then begins without them."""
    machine, recording = arm
    failed = list[int]()

    def once(*args: Any, **more: Any) -> Any:
        if args[2] and "exclude" in more and len(args[1]) == ROWS and not failed:
            failed.append(1)
            raise ConvergenceError("no minimum")
        return estimate(*args, **more)

    monkeypatch.setattr(stages, "MANY", 100)
    monkeypatch.setattr(stages, "estimate", once)
    found = diagnose(machine, recording)
    assert failed
    assert [(f.effect, f.place) for f in found.findings] == [("actuator-scale", ("q1",))]
