"""A law and what has no name beside it: the thing itself, its signal modulated by a joint, and shares of states."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from support.searched_arm import PLAY, SCALE, Case, held, searched, sums_of
from support.signature_rows import columns_at
from truepose.identification.diagnosis.posterior_summary import SURE, driver_of
from truepose.identification.diagnosis.result import NAMED
from truepose.identification.diagnosis.search import Found
from truepose.identification.posterior.posterior import AGREED
from truepose.identification.posterior.state import State
from truepose.identification.prediction.predict import simulate
from truepose.identification.recording.load import load_recording
from truepose.models.effect_text import parse_effect
from truepose.models.file.driver import DriverKind
from truepose.models.load import load_machine
from truepose.models.machine.placed import EffectAtPlace

# -- the thing itself ---------------------------------------------------------------------------------------------


def itself(found: Found, slug: str) -> float:
    """Probability that the name in the mode is the thing itself, where it is there: nothing without a name is beside it."""
    causes = {found.catalogue.cause(i) for i in found.accepted}
    own = [found.problem.causes.index(cause) for cause in causes if cause.effect == slug]
    return max((sums_of(found).law(k) / float(found.posterior.causes[k]) for k in own), default=0.0)


@pytest.mark.parametrize("truth", [(PLAY,), (SCALE,), (PLAY, SCALE)])
def test_the_thing_itself_is_told_from_what_is_like_it(truth: tuple[str, ...]) -> None:
    _, found = searched(*truth)
    for text in truth:
        assert itself(found, text.partition("@")[0]) > SURE


def modulated(folder: Path, share: float, along: str = "q1", reach: float = 160.0) -> Case:
    """Play at q2 that grows and shrinks by ``share`` over a joint's ``reach`` (deg)."""
    case = Case.of(folder, PLAY)
    machine = load_machine(folder / "arm.yaml")
    table = pd.read_csv(folder / "rows.csv")
    plain = simulate(machine, case.signatures.recording, [], seed=None)
    full = simulate(machine, case.signatures.recording, [parse_effect(PLAY, machine)], seed=None)
    t = table[f"{along} [deg]"].to_numpy() / reach
    for name in plain.columns:
        table[name] += share * t * (full[name] - plain[name]).to_numpy()
    table.to_csv(folder / "rows.csv", index=False)
    recording = load_recording(machine, [folder / "rows.csv"])
    return Case.on(machine, recording)


@pytest.mark.parametrize("along", ["q1", "q2"])
def test_the_more_play_differs_along_a_joint_the_less_it_is_play(tmp_path: Path, along: str) -> None:
    """Five percent leave the law more probable than not, ninety leave none; the joint and the side of arrival stay sure."""
    reach, laws = {"q1": 160.0, "q2": 95.0}[along], list[float]()
    for share in (0.0, 0.05, 0.9):
        (tmp_path / str(share)).mkdir()
        found = modulated(tmp_path / str(share), share, along, reach).found()
        laws.append(itself(found, "backlash"))
        assert sums_of(found).at(("q2",), "arrival") > SURE
    assert laws[0] > SURE and laws[0] + AGREED >= laws[1] > NAMED and laws[2] < 1.0 - SURE


# -- shares of states ---------------------------------------------------------------------------------------------


@given(seed=st.integers(0, 10**6))
@hypothesis_settings(max_examples=10, deadline=None)
def test_all_that_is_said_is_the_share_of_the_states_that_say_it(seed: int) -> None:
    """Of random states: each sum against a loop over all of them."""
    _, found = held(PLAY, SCALE)
    cat, problem, rng = found.catalogue, found.problem, np.random.default_rng(seed)
    some = rng.choice(len(problem.candidates), 12, replace=False)
    shares = rng.dirichlet(np.ones(9))
    states = [
        (
            State(
                tuple((int(t), 4) for t in sorted(rng.choice(some, k, replace=False))), found.mode.point, 0.0
            ),
            p,
        )
        for k, p in zip((0, 1, 1, 2, 2, 3, 3, 4, 5), shares.tolist(), strict=True)
    ]
    numbers = problem.spike_slab.terms.cause
    causes = np.zeros(len(problem.causes))
    for state, share in states:
        causes[np.unique(numbers[[t for t, _ in state.members]])] += share
    posterior = replace(found.posterior, states=tuple(states), causes=causes)
    sums = sums_of(replace(found, posterior=posterior))

    def holds(state: State, number: int) -> bool:
        """Whether it has this law, and nothing else without a name of the same nature at the same parts."""
        own = [problem.candidates[t] for t, _ in state.members]
        law = {key for i in own if cat.cause(i) == problem.causes[number] for key in _natures(found, i)}
        others = (i for i in own if not cat.named(i) and cat.cause(i) != problem.causes[number])
        return bool(law) and all(law.isdisjoint(_natures(found, i)) for i in others)

    for number in np.unique(numbers[some]).tolist():
        expected = sum(share for state, share in states if holds(state, number))
        assert sums.law(number) == pytest.approx(expected, abs=1e-12)
    laws = np.unique(numbers[some])[:4].tolist()
    expected = sum(share for state, share in states if any(holds(state, k) for k in laws))
    assert sums.any_law(laws) == pytest.approx(expected, abs=1e-12)
    for joint in ("q1", "q2"):
        at = [(state, share) for state, share in states if _drivers(found, state, joint)]
        assert sums.at((joint,)) == pytest.approx(sum(share for _, share in at), abs=1e-12)
        for kind in ("position", "coupling", "arrival", "time"):
            expected = sum(share for state, share in at if kind in _drivers(found, state, joint))
            assert sums.at((joint,), kind) == pytest.approx(expected, abs=1e-12)
    said = sums.inclusion()
    bare = [share for s, share in states if any(not cat.has_law(problem.candidates[t]) for t, _ in s.members)]
    assert said.nameless == pytest.approx(sum(bare), abs=1e-12)
    assert sum(s.probability for s in said.sets) <= 1.0 + 1e-12


def _parts(cause: EffectAtPlace) -> set[str]:
    """Parts by their names, those of constants without the constant; an axis that is coupled is the first of its place."""
    place = cause.place[:1] if cause.effect == "axis-coupling" else cause.place
    return {part.partition(".")[0] for part in place}


def _kinds(found: Found, candidate: int) -> set[DriverKind]:
    placed = found.catalogue.candidates[candidate]
    return {*placed.effect.driver_kinds(found.signatures.machine, placed.place, placed.settings_map)}


def _natures(found: Found, candidate: int) -> set[tuple[str, str]]:
    """Return the parts of a candidate, each with what its functions may be mistaken for."""
    alike = dict.fromkeys(("time", "temperature", "session"), "passing")
    alike |= {kind: kind for kind in ("arrival", "sensor")}
    natures = {alike.get(kind, "pose") for kind in _kinds(found, candidate)}
    return {(part, one) for part in _parts(found.catalogue.cause(candidate)) for one in natures}


def _drivers(found: Found, state: State, joint: str) -> set[str]:
    """What acts at a joint in a state."""
    own = (found.problem.candidates[term] for term, _ in state.members)
    here = [i for i in own if joint in _parts(found.catalogue.cause(i))]
    return {driver_of(kind) for i in here for kind in _kinds(found, i)}


# -- what forms can do --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("law", "form"),
    [
        ("actuator-scale@q1", "empirical@q1,q1,line"),
        ("axis-coupling@q2+q1", "empirical@q2,q1,line"),
        ("backlash@q2", "empirical@q2,approach.q2,q2,2"),
        ("empirical@q2,q1,2", "empirical@q2,q1,2,spatial"),
        ("empirical@q1,q1,line", "empirical@q1,q1,12"),
    ],
)
def test_a_form_can_be_all_that_a_law_of_its_driver_is_at_its_part(law: str, form: str) -> None:
    """Columns of the law lie in the space of the form's, beside geometry; a form of another part is no such thing."""
    case, _ = held(PLAY, SCALE)
    number = {c.label: i for i, c in enumerate(case.cat.candidates)}
    elsewhere = next(
        label for label in number if label.startswith("empirical@q1" if "@q2" in law else "empirical@q2")
    )
    rows = columns_at(case.signatures, case.null)
    n = rows.shape[1] - 1 - case.signatures.width

    def left(label: str) -> float:
        own, others = (n + np.array(case.signatures.indices([number[one]])) for one in (law, label))
        space = np.column_stack([rows[:, :n], rows[:, others]])
        rest = rows[:, own] - space @ np.linalg.lstsq(space, rows[:, own], rcond=None)[0]
        return float(np.linalg.norm(rest) / np.linalg.norm(rows[:, own]))

    assert left(form) < 1e-6 and left(elsewhere) > 1e-2
