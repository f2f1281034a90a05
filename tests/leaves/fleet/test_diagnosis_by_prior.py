"""A diagnosis by a learned prior: probabilities move by its odds, and evidence, which is free of any prior, does not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import truepose
from support import TESTS
from support.command import run
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.learned_prior import EffectPrior, LearnedPrior, PlacePrior
from truepose.identification.leaves.fleet.evidence import kept
from truepose.identification.leaves.fleet.learn import write_prior
from truepose.identification.leaves.fleet.place_evidence import PlaceEvidence, evidence
from truepose.identification.leaves.fleet.pooled import Pooled
from truepose.identification.prior import SIZES

CASE = TESTS / "golden_diagnoses/arm-two"
QUIET = TESTS / "golden_diagnoses/arm-quiet"
PLACE = ("zero-shift", ("q4",))
RARER = 0.05


def prior(odds: float) -> LearnedPrior:
    """Zero shifts of q4 so many times likelier, sizes as they were."""
    place = PlacePrior(machines=80, found=0.1, frequency=0.001, usual=0.006, odds=odds)
    sizes = tuple(float(f"{s:.5g}") for s in np.exp(SIZES.log_prior))
    effect = EffectPrior(machines=80, odds=1.0, sizes=sizes, places={"serial": {"q4": place}})
    return LearnedPrior(
        schema="truepose/prior/1", machines=80, mechanisms={"serial": 80}, effects={PLACE[0]: effect}
    )


def diagnosed(known: LearnedPrior | Path | None) -> Diagnosis:
    return truepose.diagnose(
        truepose.load_machine(CASE / "machine.yaml"), CASE / "recording.csv", prior=known, examine=evidence
    )


@pytest.fixture(scope="module")
def usual() -> Diagnosis:
    return diagnosed(None)


@pytest.fixture(scope="module")
def rarer(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    file = tmp_path_factory.mktemp("prior") / "prior.yaml"
    write_prior(file, prior(RARER))
    return diagnosed(file)


def of(found: Diagnosis, effect: str, place: tuple[str, ...]) -> PlaceEvidence:
    places: tuple[PlaceEvidence, ...] = found.examined[0]
    return next(one for one in places if (one.effect, one.place) == (effect, place))


def test_probabilities_move_by_the_odds_and_evidence_stays(usual: Diagnosis, rarer: Diagnosis) -> None:
    """Chains of some hundred sweeps: log odds of what is neither sure nor hopeless come out to half a nat or so. Prior odds are
    those beside what else is there, which is not quite the same."""
    before, after = of(usual, *PLACE), of(rarer, *PLACE)
    assert before.probability > 0.5 > after.probability > 0.01
    assert np.log(after.prior / before.prior) == pytest.approx(np.log(RARER), abs=0.5)
    assert after.log_bayes_factor == pytest.approx(before.log_bayes_factor, abs=0.8)
    sure = [of(found, "joint-compliance", ("q2",)) for found in (usual, rarer)]
    assert (
        rarer.prior_notes == ("the prior was learned from 80 machines (80 serial)",) and not usual.prior_notes
    )
    assert all(one.probability > 0.9 and one.log_bayes_factor > 5.0 for one in sure)


def test_what_is_kept_is_small_and_every_effect_at_every_place_is_in_it(usual: Diagnosis) -> None:
    document = kept(usual)
    text = json.dumps(document, allow_nan=False)
    assert len(text) < 15_000 and json.loads(text) == document
    assert {(one.effect, "+".join(one.place)) for one in usual.examined[0]} == {
        (effect, place) for effect, own in document["places"].items() for place in own
    }
    assert document["mechanism"] == "serial" and document["verdict"] == usual.verdict
    assert all(0.0 <= one.probability <= 1.0 and 0.0 <= one.credit <= 1.0 for one in usual.examined[0])
    size = of(usual, "joint-compliance", ("q2",)).size
    finding = next(f for f in usual.findings if f.effect == "joint-compliance")
    (value,) = finding.parameters.values()
    assert size is not None and size.unit == value.unit
    assert size.log_amount == pytest.approx(
        np.log(abs(value.value)), abs=3.0 * value.std / abs(value.value) + 0.05
    )
    assert Pooled.of([document]).machines == 1


def test_the_command_takes_the_file_and_says_where_it_is_from(tmp_path: Path) -> None:
    write_prior(tmp_path / "prior.yaml", prior(0.5))
    files = (QUIET / "machine.yaml", QUIET / "recording.csv", "--prior", tmp_path / "prior.yaml")
    run("diagnose", *files, "-o", tmp_path / "out")
    notes = json.loads((tmp_path / "out/diagnosis.json").read_text(encoding="utf-8"))["notes"]
    assert "the prior was learned from 80 machines (80 serial)" in notes
