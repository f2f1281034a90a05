"""What a hypothesis is worth: what tolerances explain, what departures cost, which hypotheses are one, and what is advised."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.checked_arm import EXACT, Document, checked, document, rig_of
from support.examples import examples
from truepose.identification.leaves.check.findings import findings, unexplained
from truepose.identification.leaves.check.kinds.joints import offset, signs
from truepose.identification.leaves.check.rig import Rig, motion
from truepose.identification.leaves.check.search import Search, shares
from truepose.identification.leaves.check.weighing import (
    CERTAIN,
    PHYSICS,
    Hypothesis,
    Weighed,
    evidence,
    expected,
    settle,
    weigh,
)
from truepose.identification.prediction.predictor import Predictor

FINE = {"type": "pose", "sigma": {"xyz": 1e-4, "rot": 1e-4}}
INF = float("inf")


def drawn(length: float = 0.2, angle: float = 0.05, sensor: dict[str, Any] = FINE) -> Document:
    return document(sensor=sensor, tolerances={"length": length, "angle": angle})


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    return rig_of(tmp_path_factory.mktemp("arm"), document(sensor=EXACT))


@pytest.fixture(scope="module")
def whole(arm: Rig) -> Weighed:
    return weigh(arm, Hypothesis((), arm.scene))


def test_what_tolerances_leave_is_what_the_frames_cannot_take(tmp_path: Path) -> None:
    """Rms of what each constant moves the readings by, off the space of what the two frames move them by."""
    rig = rig_of(tmp_path, drawn())
    stand = rig.stand()
    here = Predictor(rig.machine, rig.recording)
    x, good = here.assemble(stand.p)
    jacobian = np.concatenate([block.jacobian for block in here.blocks(stand.p, x)])
    assert good.all() and len(jacobian) == len(rig.recording)
    flat = jacobian.reshape(-1, len(stand.p))
    frames = np.concatenate([rig.at["base"], rig.at["tool"]])
    others = np.setdiff1d(np.flatnonzero(rig.tolerance > 0), frames)
    moved = flat[:, others] * rig.tolerance[others]
    left = moved - flat[:, frames] @ np.linalg.lstsq(flat[:, frames], moved, rcond=None)[0]
    assert expected(rig, stand) == pytest.approx(np.sqrt(1.0 + np.sum(left**2) / len(flat)), rel=1e-6)


@pytest.mark.parametrize("frame", ["base", "tool"])
def test_a_frame_that_is_known_costs_its_tolerances_and_a_free_one_nothing(
    frame: str, tmp_path: Path
) -> None:
    """Three tolerances off, and readings so fine that nothing else pays."""
    real = drawn()
    real["frames"][frame]["xyz"][0] += 3.0 * {"base": 5.0, "tool": 2.0}[frame]
    rig = rig_of(tmp_path, drawn(), real, rows=10)
    stand = rig.stand()
    rest = "tool" if frame == "base" else "base"
    known, free, other = (settle(rig, stand, f) for f in ((), (frame,), (rest,)))
    assert max(one.misfit for one in (known, free, other)) < 0.01
    assert known.price == pytest.approx(3.0 / np.sqrt(0.8 * 60), rel=0.02)  # over the readings of eight rows
    assert free.price < 0.01 and other.price == pytest.approx(known.price, rel=1e-3)
    assert known.farthest == pytest.approx(3.0, rel=0.02) and f"{frame}.x" in known.away
    assert f"{frame}.x" not in free.away
    nowhere = settle(rig, replace(stand, misfit=INF))
    assert nowhere.price == nowhere.misfit == INF


def test_gross_rows_are_in_no_price(tmp_path: Path) -> None:
    rig = rig_of(tmp_path, drawn(), rows=20)
    z = rig.scene.rows.observations["z"].copy()
    z[[3, 11, 17]] += 500.0
    assert settle(rig, rig.stand(rig.scene.with_columns({"z": z}))).price < 0.01
    z[[1, 5]] += 500.0
    assert settle(rig, rig.stand(rig.scene.with_columns({"z": z}))).price > 100.0  # a quarter of the rows


sizes, odds = st.floats(0.2, 1e6), st.floats(1e-6, 1.0)


@given(sizes, sizes, odds, odds)
def test_evidence_falls_with_the_misfit_and_with_how_seldom_a_slip_is(
    arm: Rig, one: float, other: float, usual: float, seldom: float
) -> None:
    """And a factor of the measured lengths takes their misfit back, as a mean over the kinds of reading."""
    less, more = sorted((one, other))
    rare, often = sorted((usual, seldom))
    score = partial(evidence, arm, arm.scene)
    assert score(less, often) >= score(more, often) and score(less, often) >= score(less, rare)
    assert score(more, often) - score(more, rare) == pytest.approx(np.log(often / rare))
    larger = replace(arm.scene, size=100.0)
    # of half the readings
    assert evidence(arm, larger, 10.0 * more, often) == pytest.approx(score(more, often))
    assert score(INF, often) == -np.inf


@settings(max_examples=examples(10))
@given(st.floats(-3.0, 3.0))
def test_the_zero_of_an_end_and_a_frame_that_is_free_are_one_hypothesis(free_base: Rig, turn: float) -> None:
    """They predict alike in every pose, so that neither takes of the other's probability."""
    rig = free_base
    every = [weigh(rig, Hypothesis((), rig.scene))]
    for slip in (offset(rig, 0, turn), offset(rig, 0, turn / 2)):
        every.append(weigh(rig, Hypothesis((), rig.scene).with_slip(slip)))
    slip = next(s for s in signs(rig, rig.scene) if s.where == ("q3",))
    other = weigh(rig, Hypothesis((), rig.scene).with_slip(slip))
    classes = shares(rig, [*every, other])
    assert classes[0][1] > CERTAIN
    assert other not in classes[0][0] and every[0] in classes[0][0]


@pytest.fixture(scope="module")
def free_base(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    stated = document(sensor=EXACT)
    stated["frames"]["base"]["tolerance"] = {"xyz": INF, "rpy": INF}
    return rig_of(tmp_path_factory.mktemp("free"), stated)


@pytest.mark.parametrize("near", [True, False])
@given(share=st.floats(0.0, 1.0))
def test_a_mend_is_advised_only_where_one_class_is_certain_and_near(
    whole: Weighed, arm: Rig, near: bool, share: float
) -> None:
    bad = replace(whole, near=False, score=whole.score - 50.0)
    slip = next(iter(signs(arm, arm.scene)))
    first = replace(whole, hypothesis=Hypothesis((slip,), arm.scene), near=near)
    second = replace(first, hypothesis=Hypothesis((offset(arm, 3, 1.0),), arm.scene))
    found = Search(bad, (((first,), share), ((second,), 1.0 - share)))
    advised = near and share >= CERTAIN
    assert (found.advised is not None) == advised
    assert found.best is (first if advised else bad)
    said = findings(arm, found)
    assert len(said) == 1 and (said[0].mend is not None) == advised
    if not advised:
        assert said[0].says.startswith("it may be: ") and said[0].verdict == "suspect"
        assert ("something else is wrong too" in said[0].says) == (not near)


def test_of_two_slips_that_fit_alike_none_is_mended(tmp_path: Path) -> None:
    """Where two joints always moved together nobody can tell from which of them a third was counted."""
    drawn_arm = document(sensor=EXACT)
    rig = rig_of(tmp_path, drawn_arm, rows=20)
    q = rig.recording.q.copy()
    q[:, 3] = q[:, 1]
    here = rig.predictor.over(replace(rig.recording, q=q))
    values = here.values(rig.scene.p, here.assemble(rig.scene.p)[0])[1]
    counted = np.degrees(q + q[:, [1]] * [0, 0, 1, 0, 0, 0])
    seen = values * np.array([1.0] * 3 + [180 / np.pi] * 3)
    names = [*rig.recording.joints, "x", "y", "z", "rx", "ry", "rz"]
    found = checked(tmp_path, drawn_arm, pd.DataFrame(np.hstack([counted, seen]), columns=names))
    (first,) = found.found
    assert first.mend is None and first.says.startswith("it may be: the reading of q3 is coupled")
    assert "compare with the source" in first.fix
    asked = " ".join([first.says, *first.instead])
    assert "+ q2" in asked and "+ q4" in asked


def test_what_nothing_explains_is_told_by_its_size(tmp_path: Path) -> None:
    rig = rig_of(tmp_path, drawn())
    stand = rig.stand()
    limit = PHYSICS * motion(rig, stand)
    for misfit, verdict in ((0.99 * limit, "suspect"), (1.01 * limit, "wrong")):
        found = unexplained(rig, replace(stand, misfit=misfit, length=12.3456))
        assert (found.kind, found.where, found.verdict) == ("unexplained", (), verdict)
        assert (found.before, found.after, found.unit, found.mend) == (12.3456, None, "mm", None)
    turned = unexplained(rig, replace(stand, misfit=12.3456, length=None))
    assert (turned.before, turned.unit) == (12.3456, "sigma")
    nowhere = unexplained(rig, replace(stand, misfit=INF, length=None))
    assert (nowhere.verdict, nowhere.before) == ("wrong", None)
