"""Forward selection and its refits: what is left is worth its place, impossible terms go, two halves become one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from truepose.identification.diagnosis.effect_evidence import grid_for
from truepose.identification.diagnosis.effect_selection import (
    THRESHOLD,
    WIDE,
    Selection,
    _join_pairs,
    log_posterior,
    rank,
    select,
)
from truepose.identification.diagnosis.refit import refit

from truepose.errors import ConvergenceError
from truepose.identification.diagnosis import refit as refits
from truepose.identification.diagnosis.candidates import Catalogue, catalogue
from truepose.identification.diagnosis.signatures import Signatures
from truepose.identification.fit.estimate import Estimate, estimate
from truepose.identification.prediction.simulate import parse_effect, simulate
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

ARM = """
schema: truepose/machine/1
name: arm
tolerances: {length: 0.1, angle: 0.05}
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, d: 50, range: [-100, 100]}
frames: {tool: {in: flange, xyz: [300, 0, 40], tolerance: {xyz: 0.5, rpy: 0}}}
sensor: {type: position, sigma: {xyz: 0.01}}
"""
ROWS = 40
PLAY, SCALE = "backlash@q2:b=0.05[deg]", "actuator-scale@q1:s=2e-3"


@dataclass(frozen=True)
class Case:
    """A small arm with something simulated in it, its candidates, and the fit without them."""

    cat: Catalogue
    signatures: Signatures
    null: Estimate

    @classmethod
    def of(cls, folder: Path, *truth: str) -> Case:
        (folder / "arm.yaml").write_text(ARM)
        machine, rng = load_machine(folder / "arm.yaml"), np.random.default_rng(12)
        table = pd.DataFrame(rng.uniform(-1, 1, (ROWS, 2)) * [160, 95], columns=["q1 [deg]", "q2 [deg]"])
        table["approach.q1"], table["approach.q2"] = rng.choice([-1.0, 1.0], (2, ROWS))
        table.to_csv(folder / "poses.csv", index=False)
        poses = load_recording(machine, [folder / "poses.csv"], need_observations=False)
        read = simulate(machine, poses, [parse_effect(text, machine) for text in truth], seed=3)
        pd.concat([table, read], axis=1).to_csv(folder / "rows.csv", index=False)
        recording = load_recording(machine, [folder / "rows.csv"])
        cat = catalogue(machine, recording)
        return cls(cat, Signatures(machine, recording, cat.candidates), estimate(machine, recording))

    @property
    def exclude(self) -> NDArray[np.bool_]:
        return np.zeros(ROWS, dtype=np.bool_)

    def of_effect(self, slug: str, place: str) -> int:
        return next(
            i for i, c in enumerate(self.cat.candidates) if (c.effect.slug, c.place) == (slug, (place,))
        )

    def with_terms(self, *terms: int) -> Selection:
        lin = self.signatures.linearise(self.null)
        accepted = dict.fromkeys(terms, WIDE)
        return Selection(accepted, self.null, lin, grid_for(lin, 10.0), self.signatures, self.cat)


def test_what_is_selected_is_worth_its_place_and_nothing_else_is(tmp_path: Path) -> None:
    case = Case.of(tmp_path, PLAY, SCALE)
    found = select(case.signatures, case.cat, case.null, case.exclude, 10.0)
    names = {(c.effect.slug, c.place) for c in (found.catalogue.candidates[i] for i in found.accepted)}
    assert names == {("backlash", ("q2",)), ("actuator-scale", ("q1",))}
    lin, cat, grid = found.linearisation, found.catalogue, found.grid
    for term in found.accepted:
        rest = {i: v for i, v in found.accepted.items() if i != term}
        assert rank(lin, cat, grid, rest, [term]).odds[0] > THRESHOLD
    others = [i for i in range(len(cat.candidates)) if i not in found.accepted]
    assert np.max(rank(lin, cat, grid, found.accepted, others).odds) <= THRESHOLD


def test_a_search_goes_on_from_an_earlier_one_to_the_same_end(tmp_path: Path) -> None:
    case = Case.of(tmp_path, PLAY)
    first = select(case.signatures, case.cat, case.null, case.exclude, 10.0)
    some = case.exclude
    some[::10] = True
    again = select(case.signatures, case.cat, case.null, some, 10.0, first)
    assert set(again.accepted) == set(first.accepted) == {case.of_effect("backlash", "q2")}
    assert not again.fit.used[some].any()


def test_the_weight_of_a_selection_is_the_sum_of_its_steps(tmp_path: Path) -> None:
    case = Case.of(tmp_path, PLAY, SCALE)
    play, scale = case.of_effect("backlash", "q2"), case.of_effect("actuator-scale", "q1")
    empty, one, two = case.with_terms(), case.with_terms(play), case.with_terms(play, scale)
    steps = [
        rank(s.linearisation, case.cat, s.grid, s.accepted, [i]).odds[0]
        for s, i in ((empty, play), (one, scale))
    ]
    assert min(steps) > THRESHOLD
    assert log_posterior(two) - log_posterior(empty) == pytest.approx(sum(steps), rel=1e-9)


def test_two_terms_that_are_halves_of_one_become_that_one(tmp_path: Path) -> None:
    case = Case.of(tmp_path, PLAY)
    halves = case.with_terms(case.of_effect("actuator-scale", "q2"), case.of_effect("actuator-scale", "q1"))
    play = case.of_effect("backlash", "q2")
    joined = _join_pairs(halves.linearisation, case.cat, halves.grid, halves.accepted, set())
    assert set(joined) == {play}
    assert log_posterior(case.with_terms(*joined)) > log_posterior(halves)
    # what may not be taken is not, and a true pair stays
    banned = _join_pairs(halves.linearisation, case.cat, halves.grid, halves.accepted, {play})
    assert play not in banned


def test_a_pair_that_is_there_stays_a_pair(tmp_path: Path) -> None:
    case = Case.of(tmp_path, PLAY, SCALE)
    pair = case.with_terms(case.of_effect("backlash", "q2"), case.of_effect("actuator-scale", "q1"))
    assert _join_pairs(pair.linearisation, case.cat, pair.grid, pair.accepted, set()) == pair.accepted


def test_a_term_of_the_wrong_sign_is_banned_and_the_fit_is_the_one_without_it(tmp_path: Path) -> None:
    case = Case.of(tmp_path, "backlash@q2:b=-0.05[deg]", SCALE)
    play, scale = case.of_effect("backlash", "q2"), case.of_effect("actuator-scale", "q1")
    banned: set[int] = set()
    fit, left = refit(case.signatures, case.cat, {play: WIDE, scale: WIDE}, case.null, case.exclude, banned)
    assert banned == {play} and left == {scale: WIDE}
    alone, _ = refit(case.signatures, case.cat, {scale: WIDE}, case.null, case.exclude, set())
    np.testing.assert_allclose(fit.p, alone.p, rtol=1e-6, atol=1e-9)


def test_without_a_minimum_the_newest_term_goes_and_the_last_error_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = Case.of(tmp_path, SCALE)
    scale, play = case.of_effect("actuator-scale", "q1"), case.of_effect("backlash", "q2")
    most = 1

    def fails(machine: object, recording: object, terms: list[object], **others: object) -> Estimate:
        if len(terms) > most:
            raise ConvergenceError("no minimum")
        return estimate(machine, recording, terms, **others)  # type: ignore[arg-type]

    monkeypatch.setattr(refits, "estimate", fails)
    banned: set[int] = set()
    _, left = refit(case.signatures, case.cat, {scale: WIDE, play: WIDE}, case.null, case.exclude, banned)
    assert list(left) == [scale] and banned == {play}
    most = -1
    with pytest.raises(ConvergenceError, match="no minimum"):
        refit(case.signatures, case.cat, {scale: WIDE}, case.null, case.exclude, set())
