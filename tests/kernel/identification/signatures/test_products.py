"""Laws of forms of several sources: their screen weighs them as whole matrices do, and what is there is proposed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import cho_solve
from scipy.special import logsumexp

from support.searched_arm import ARM
from support.sensor_bench import Bench
from support.signature_rows import columns_at
from support.simulated import machine_from, poses_of
from truepose.arrays import Array, Index
from truepose.identification import prior
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.predict import simulate
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.linearisation import Linearisation
from truepose.identification.signatures.products import (
    MOST,
    Element,
    Form,
    Screen,
    elements_of,
    forms_of,
    proposed_products,
)
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.empirical import Empirical
from truepose.models.effects.polynomials import exponents
from truepose.models.machine.machine import Machine

ROWS = 60
HEAVY = "gravity: [0, 0, -9.80665]\nmasses: {head: {kg: 20, com: [0, 0, 0], in: tool}}\n"


@dataclass(frozen=True)
class Screened:
    """A machine, its recording and a fit of it, with effects or without."""

    machine: Machine
    recording: Recording
    fit: Estimate

    @property
    def signatures(self) -> Signatures:
        return Signatures(self.machine, self.recording, self.fit.effects)

    @cached_property
    def elements(self) -> dict[str, Element]:
        cat = catalogue(self.machine, self.recording)
        return {element.place: element for element in elements_of(self.machine, cat)}

    @cached_property
    def screen(self) -> Screen:
        return Screen(self.signatures, self.fit, list(self.elements.values()))

    def forms(self) -> dict[str, list[Form]]:
        joints = self.machine.mechanism.readings
        return {place: list(forms_of(element, joints)) for place, element in self.elements.items()}


def hosed(folder: Path, pull: float, text: str = ARM, seed: int = 4) -> tuple[Machine, Recording]:
    """An arm whose q2 is pulled at by a hose, as far as it is wound by q1 and held up by q2 itself, ``pull`` rad at most."""
    machine, rng = machine_from(folder, text, "arm"), np.random.default_rng(seed)
    table = pd.DataFrame(rng.uniform(-1, 1, (ROWS, 2)) * [160, 95], columns=["q1 [deg]", "q2 [deg]"])
    q1, q2 = np.radians(table.to_numpy().T)
    true = table.assign(
        **{"q2 [deg]": np.degrees(q2 + pull * np.sin(0.6 * q1 + 0.3) * np.cos(0.7 * q2 - 0.4))}
    )
    read = simulate(machine, poses_of(machine, true), [], seed=3)
    return machine, load_recording(machine, pd.concat([table, read], axis=1))


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Screened]:
    """Arms of which one carries weight and one has an effect in its fit, and a stage whose readings are changes from rows."""
    made = dict[str, Screened]()
    for name, text in (("arm", ARM), ("heavy", ARM + HEAVY)):
        machine, recording = hosed(tmp_path_factory.mktemp(name), 3e-4, text)
        made[name] = Screened(machine, recording, estimate(machine, recording))
    machine, recording = made["arm"].machine, made["arm"].recording
    own = [
        c for c in catalogue(machine, recording).candidates if c.label in ("actuator-scale@q1", "backlash@q2")
    ]
    made["effects"] = Screened(machine, recording, estimate(machine, recording, own))
    bench = Bench(tmp_path_factory.mktemp("stage"), "stage")
    changes = bench.recording()
    made["stage"] = Screened(bench.machine, changes, estimate(bench.machine, changes))
    return made


FORMS = [
    ("arm", Form("q2", ("q1", "q2"), 2, spatial=False)),
    ("arm", Form("q2", ("q1", "q2"), 4, spatial=True)),
    ("arm", Form("base", ("q1", "q2"), 3, spatial=False)),
    ("arm", Form("q1", ("q2", "approach.q1"), 2, spatial=True)),
    ("effects", Form("q2", ("q1", "q2"), 4, spatial=False)),
    ("effects", Form("tool", ("q2", "row"), 3, spatial=False)),
    ("heavy", Form("q2", ("q1", "load"), 4, spatial=True)),
    ("stage", Form("t", ("x", "y"), 2, spatial=False)),
    ("stage", Form("x", ("y", "t"), 4, spatial=True)),
    ("stage", Form("base", ("x", "t"), 3, spatial=False)),
]


def placed_of(case: Screened, form: Form) -> PlacedEffect:
    """The form as a candidate."""
    settings = form.settings(case.elements[form.place].sources)
    return PlacedEffect.at(Empirical(), case.machine, (form.place,), settings)


def as_screened(form: Form, placed: PlacedEffect) -> Index:
    """Where the coefficients of a candidate stand in the order of the screen: all functions of one motion, then of the next.

    A candidate has its sources in the order of their names.
    """
    names = [c.name for c in placed.coefficients]
    motions = list(dict.fromkeys(name.rstrip("0123456789.") for name in names))
    order = np.argsort(form.sources)
    functions = [".".join(str(e[k]) for k in order) for e in exponents(len(form.sources), form.degree)]
    return np.array([names.index(f"{motion}{f}") for motion in motions for f in functions])


def weights(case: Screened, lin: Linearisation) -> Array:
    """(u,) of geometry and the fit's effects: one over the prior 1-sigma of what columns of [J G] stand for."""
    scales = [c.scale for effect in case.fit.effects for c in effect.coefficients]
    sigma = case.fit.prior.sigma[case.fit.prior.free][lin.free :]
    return np.concatenate([lin.weight, np.array(scales) / sigma])


def linearised(case: Screened, placed: PlacedEffect) -> tuple[Signatures, Linearisation]:
    """Of the fit's effects and of a form behind them."""
    signatures = case.signatures.of((*case.fit.effects, placed))
    return signatures, signatures.linearise(case.fit)


@pytest.mark.parametrize(("name", "form"), FORMS)
def test_the_screen_of_a_form_has_the_gram_matrix_and_scores_of_its_signatures(
    cases: dict[str, Screened], name: str, form: Form
) -> None:
    """Geometry and effects projected out, from sums over rows or from all readings at once."""
    case = cases[name]
    screen = case.screen
    gram, across, score = screen.motions[form.place, form.spatial].normal(screen.functions(form))
    gram = gram - across @ cho_solve(screen.rows.factor, across.T)
    placed = placed_of(case, form)
    _, lin = linearised(case, placed)
    order = as_screened(form, placed)
    own, known = lin.free + lin.columns[-1].start + order, np.arange(lin.free + lin.columns[-1].start)
    inside = lin.among(known, known) + np.diag(weights(case, lin) ** 2)
    left = np.linalg.solve(inside, lin.among(known, own))
    residual, length = lin.gram[:, -1], np.sqrt(np.diag(lin.gram)[own])
    expected = lin.among(own, own) - lin.among(own, known) @ left
    lengths = np.outer(length, length)
    np.testing.assert_allclose(gram / lengths, expected / lengths, atol=1e-7)
    np.testing.assert_allclose(score / length, (residual[own] - residual[known] @ left) / length, atol=1e-6)


@pytest.mark.parametrize(("name", "form"), FORMS)
def test_a_form_gains_what_densities_of_all_readings_say(
    cases: dict[str, Screened], name: str, form: Form
) -> None:
    """Of its size and of the noise, up to what the fit leaves, which geometry and effects are free to follow."""
    case = cases[name]
    signatures, lin = linearised(case, placed_of(case, form))
    rows, known = columns_at(signatures, case.fit), lin.free + lin.columns[-1].start
    weight = np.maximum(weights(case, lin), 1e-4 * np.linalg.norm(rows[:, :known], axis=0) + 1e-9)
    columns, e = rows[:, :known] / weight, rows[:, -1]
    base, beside = np.eye(len(e)) + columns @ columns.T, rows[:, known:-1] @ rows[:, known:-1].T
    rms = np.sqrt(max(float(e @ np.linalg.solve(base, e)) / len(e), 1.0))
    noises = np.geomspace(1.0, rms, 5) if rms > 1.0 else np.ones(1)
    plain = [density(e, noise**2 * base) for noise in noises]
    sizes = [[density(e, noise**2 * base + q**2 * beside) for q in prior.SIZES.values] for noise in noises]
    found = case.screen.gain(form)
    expected = np.max(logsumexp(np.array(sizes) + prior.SIZES.log_prior, axis=1)) - np.max(plain)
    assert found == pytest.approx(expected, abs=1e-3)
    assert len(noises) > 1 or name not in ("arm", "heavy")


def density(e: Array, spread: Array) -> float:
    """Logarithm of a normal density, less what is the same of all."""
    return float(-0.5 * (np.linalg.slogdet(spread)[1] + e @ np.linalg.solve(spread, e)))


# -- what is proposed ---------------------------------------------------------------------------------------------


def test_what_a_hose_does_is_proposed_at_its_joint(cases: dict[str, Screened]) -> None:
    """First of all, as a function of both joints; with the prior that it would have had among all of its place."""
    case = cases["arm"]
    cat = catalogue(case.machine, case.recording)
    signatures = Signatures(case.machine, case.recording, cat.candidates)
    more = proposed_products(signatures, case.fit, cat)
    first, *others = more.candidates[len(cat.candidates) :]
    assert len(others) < MOST and more.candidates[: len(cat.candidates)] == cat.candidates
    assert first.place == ("q2",) and {"from.q1", "from.q2"} <= set(first.settings_map)
    assert len({c.label for c in more.candidates}) == len(more.candidates)
    assert not any(more.has_law(k) for k in range(len(cat.candidates), len(more.candidates)))
    count = {place: len(forms) for place, forms in case.forms().items()}
    log_prior = dict(zip(more.candidates, more.log_prior, strict=True))
    for form in (first, *others):
        of_one = [c for c in cat.candidates if sum(name.startswith("from.") for name in c.settings_map) == 1]
        alike = [log_prior[c] for c in of_one if c.at_place == form.at_place]
        assert log_prior[form] == pytest.approx(logsumexp(alike) - np.log(count[form.place[0]]))
    assert more.log_prior[: len(cat.candidates)] == cat.log_prior


def test_where_nothing_is_left_nothing_is_proposed(tmp_path: Path) -> None:
    machine, recording = hosed(tmp_path, 0.0)
    cat = catalogue(machine, recording)
    signatures = Signatures(machine, recording, cat.candidates)
    assert proposed_products(signatures, estimate(machine, recording), cat) is cat


def test_every_pair_of_a_joint_or_a_load_is_screened_at_every_joint_and_mount(
    cases: dict[str, Screened],
) -> None:
    """What never varies is in no pair, and a mount has no side that it is arrived from."""
    case = cases["heavy"]
    found = case.forms()
    assert set(found) == {"q1", "q2", "base", "tool"}
    for place, forms in found.items():
        sources = {*case.elements[place].sources}
        assert {"q1", "q2", "row"} <= sources and ("load" in sources or place != "q2")
        assert not {"load", "approach.q1", "approach.q2"} & sources or place in ("q1", "q2")
        moving = {"q1", "q2", "load"}
        expected = {frozenset((a, b)) for a in sources for b in sources if a != b and {a, b} & moving}
        assert {frozenset(form.sources) for form in forms} == expected
        assert len(set(forms)) == len(forms) == len(expected) * (1 if place in ("base", "tool") else 3)
    still = replace(case.recording, q=case.recording.q * [1.0, 0.0])
    alone = replace(case, recording=still)
    assert all("q2" not in form.sources for forms in alone.forms().values() for form in forms)
    assert "load" not in case.elements["q1"].sources  # upright: what it carries is rounding
