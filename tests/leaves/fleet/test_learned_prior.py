"""Laws of the prior that a fleet leaves: what it moves, how far, and that nothing of it is lost in its file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from support.fleets import DrawnFleet
from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification import prior
from truepose.identification.diagnosis.selection_problem import SelectionProblem, selection_problem
from truepose.identification.fit.estimate import estimate
from truepose.identification.learned_prior import FleetPrior, LearnedPrior, read_prior
from truepose.identification.leaves.fleet.learn import learned, prior_text, write_prior
from truepose.identification.leaves.fleet.pooled import Pooled
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue, catalogue
from truepose.identification.signatures.linearisation import Linearisation
from truepose.identification.signatures.signatures import Signatures
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import EffectAtPlace


def fleet(frequencies: list[float], number: int, size: int = 5) -> LearnedPrior:
    rng = np.random.default_rng(0)
    drawn = DrawnFleet(np.array(frequencies), size, -4.0)
    return learned(Pooled.of([drawn.machine(rng) for _ in range(number)]))


@pytest.fixture(scope="module")
def frequent() -> LearnedPrior:
    """Of 100 machines: backlash at q1 in 40 %, at q2 and q3 never."""
    return fleet([0.4, 0.0, 0.0], 100)


def test_a_frequent_effect_is_likelier_others_are_rarer_and_all_stay_possible(frequent: LearnedPrior) -> None:
    places = frequent.effects["backlash"].places["serial"]
    assert 0.28 < places["q1"].frequency < 0.52 and places["q1"].odds > 15.0
    for name in ("q2", "q3"):
        assert 0.02 < places[name].odds < 1.0  # never seen in 100 machines: fifty times rarer at most
        assert places[name].odds < frequent.effects["backlash"].odds  # than at a place that no machine has
    assert frequent.machines == 100 and frequent.mechanisms == {"serial": 100}


@pytest.mark.parametrize("number", [1, 2, 3])
def test_few_machines_hardly_move_it(number: int) -> None:
    """Absent in up to three machines: less than a tenth. There in one: ten times as likely at most, from 2 to 20 %."""
    for place in fleet([0.0, 0.0], number).effects["backlash"].places["serial"].values():
        assert 0.85 < place.odds <= 1.0
    assert fleet([1.0, 0.0], 1).effects["backlash"].places["serial"]["q1"].odds < 15.0


def test_what_it_moves_grows_with_the_machines_that_say_so() -> None:
    odds = [fleet([1.0, 0.0], n).effects["backlash"].places["serial"]["q1"].odds for n in (1, 4, 16, 64)]
    assert odds == sorted(odds) and odds[0] > 1.0
    sizes = np.array([fleet([1.0, 1.0], n, size=6).effects["backlash"].sizes for n in (1, 64)])
    assert np.argmax(sizes[1]) == 6 and sizes[1].max() > sizes[0].max() > np.exp(prior.SIZES.log_prior).max()


def test_no_machines_leave_the_prior_as_it_was(recorded: tuple[Machine, Recording]) -> None:
    assert learned(Pooled.of([])) == LearnedPrior(schema="truepose/prior/1")
    lin, cat = _listed(*recorded)
    before, after = (_problem(lin, cat, known) for known in (None, learned(Pooled.of([]))))
    assert after.richness == before.richness
    np.testing.assert_array_equal(_logs(after), _logs(before))
    np.testing.assert_array_equal(_logs(after, (0, 4)), _logs(before, (0, 4)))


def test_odds_of_a_place_are_as_many_times_what_they_were_and_no_others_move(
    recorded: tuple[Machine, Recording], frequent: LearnedPrior
) -> None:
    """At each richness, at every size by the shares learned; whatever takes part in the urns beside other members."""
    lin, cat = _listed(*recorded)
    before, after = (_problem(lin, cat, known) for known in (None, frequent))
    slots = [
        np.log(np.array(p.richness.filled) / (1.0 - np.array(p.richness.filled))) for p in (before, after)
    ]
    np.testing.assert_allclose(np.ptp(slots[1] - slots[0]), 0.0, atol=1e-12)
    change = (slots[1] - slots[0])[0] + _logs(after) - _logs(before)  # (s, c)
    known, size = FleetPrior(frequent, recorded[0].mechanism_type), after.spike_slab.sizes.log_prior
    for k, i in enumerate(after.candidates):
        cause = cat.cause(i)
        sizes = known.log_sizes(cause.effect)
        expected = known.log_odds(cause) + (0.0 if sizes is None else sizes - size)
        np.testing.assert_allclose(change[:, k], expected, atol=1e-9)
    assert {cat.cause(i).effect for i in after.candidates} > {"backlash"}


def test_machines_of_another_type_hear_of_effects_alone(frequent: LearnedPrior) -> None:
    cause, effect = EffectAtPlace("backlash", ("q1",)), frequent.effects["backlash"]
    assert FleetPrior(frequent, "serial").log_odds(cause) == pytest.approx(
        np.log(effect.places["serial"]["q1"].odds)
    )
    other = FleetPrior(frequent, "6-ups")
    assert other.log_odds(cause) == pytest.approx(np.log(effect.odds))
    assert other.log_odds(EffectAtPlace("gravity-sag", ("base",))) == 0.0
    assert "100 serial" in other.notes([cause])[0] and "6-ups" in other.notes([cause])[0]
    assert "6-ups" not in FleetPrior(frequent, "serial").notes([cause])[0]
    foreign = frequent.model_copy(update={"effects": {"of-a-plug-in": effect, **frequent.effects}})
    assert "of-a-plug-in" in FleetPrior(foreign, "serial").notes([cause])[1]


def test_the_file_gives_back_what_was_written(tmp_path: Path, frequent: LearnedPrior) -> None:
    for known in (frequent, LearnedPrior(schema="truepose/prior/1")):
        write_prior(tmp_path / "prior.yaml", known)
        assert read_prior(tmp_path / "prior.yaml") == known
    assert "# Learned from 100 machines" in prior_text(frequent)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "truepose/prior/1",
            "truepose/prior/2",
            "schema: found 'truepose/prior/2', expected 'truepose/prior/1'",
        ),
        ("effects:\n", "efects:\n", "efects: unknown field"),
        ("  sizes: [", "  sizes: [0.5, ", "effects.backlash.sizes: expected 9 shares that add up to 1"),
        ("q1: {machines: 100", "q1: {machines: -3", "effects.backlash.places.serial.q1.machines: "),
    ],
)
def test_errors_say_file_field_found_and_expected(
    tmp_path: Path, frequent: LearnedPrior, old: str, new: str, said: str
) -> None:
    text = prior_text(frequent)
    assert old in text
    file = tmp_path / "fleet.yaml"
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read_prior(file)
    assert str(refused.value).startswith(f"{file}: {said}") and "\n" not in str(refused.value)


def _listed(machine: Machine, recording: Recording) -> tuple[Linearisation, Catalogue]:
    cat = catalogue(machine, recording)
    return Signatures(machine, recording, cat.candidates).linearise(estimate(machine, recording)), cat


def _problem(lin: Linearisation, cat: Catalogue, known: LearnedPrior | None) -> SelectionProblem:
    own = None if known is None else FleetPrior(known, "serial")
    return selection_problem(lin, replace(cat, learned=own), 1.0)


def _logs(problem: SelectionProblem, *members: tuple[int, int]) -> Array:
    return problem.spike_slab.terms.log_prior(members)


# -- a small prior in full ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("odds", "off", "taken"),
    [
        (1e6, 0.0, True),
        (1e-6, 0.0, True),
        (1.1e6, 0.0, False),
        (0.9e-6, 0.0, False),
        (1.0, 0.009, True),
        (1.0, 0.011, False),
        (1.0, -0.011, False),
    ],
)
def test_odds_beyond_a_million_and_shares_that_do_not_add_up_are_refused(
    frequent: LearnedPrior, odds: float, off: float, taken: bool
) -> None:
    """A hundredth of rounding is none."""
    written = frequent.model_dump(by_alias=True)
    effect = written["effects"]["backlash"]
    effect["odds"], effect["sizes"] = odds, [effect["sizes"][0] + off, *effect["sizes"][1:]]
    if taken:
        assert LearnedPrior.model_validate(written).effects["backlash"].odds == odds
    else:
        with pytest.raises(ValidationError):
            LearnedPrior.model_validate(written)
