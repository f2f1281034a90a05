"""What speaks for a verdict and what speaks against it: a sentence for each, at both sides of what it depends on."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from support.told_diagnoses import diagnosis, finding, fits
from truepose.identification.diagnosis.result import (
    NOTABLE,
    Alarm,
    Alternative,
    BlockProof,
    OpenQuestion,
    Proof,
    Quantity,
)
from truepose.identification.posterior.posterior import AGREED
from truepose.identification.report.verdict import doubts, headline, reasons

NAN = float("nan")


def proof(**changes: Any) -> Proof:
    return replace(Proof("role", (), 0.4, (0.3, 0.5), -0.5, 0.97, True), **changes)


@pytest.mark.parametrize(
    ("changes", "doubt"),
    [
        ({}, ""),
        ({"ratio_interval": (0.3, 0.999)}, ""),
        ({"ratio_interval": (0.3, 1.0)}, "Held-out rows show no certain gain."),
        ({"ratio_interval": (0.3, NAN)}, ""),
        ({"placebo_gain": NOTABLE}, ""),
        ({"placebo_gain": 3.1}, "A placebo (the same effect with shuffled drivers) gains 3.10 too"),
        ({"placebo_gain": None}, ""),
        ({"black_box_ratio": 0.41}, ""),
        ({"black_box_ratio": 0.4}, "An equally flexible black box does as well on held-out rows (0.400)."),
        ({"black_box_ratio": NAN}, ""),
        ({"injected_recovered": None}, ""),
        ({"injected_recovered": False}, "The effect, put into simulated readings at the size found here, was not"),
        ({"blocks": (BlockProof("q", 1, 1.0), BlockProof("r", 9, NAN))}, ""),
        ({"blocks": (BlockProof("far poses", 1, 1.01),)}, "Held out, the far poses (1 row) get worse: rms rises to 1.01"),
    ],
)  # fmt: skip
def test_each_part_of_a_proof_that_fails_is_one_doubt(changes: dict[str, Any], doubt: str) -> None:
    own = replace(finding(0.99, 1), parameters={"a": Quantity(1.0, 0.1, "1")})
    found = doubts(diagnosis("missing-physics", own, proof=proof(**changes)))
    assert len(found) == bool(doubt) and all(one.startswith(doubt) for one in found)


def test_doubts_beside_the_proof() -> None:
    """Amplitudes within their own uncertainty, chains that differ, structure that is left, a constant still far out."""
    sizes = {"a": Quantity(-2.01, 1.0, "1"), "b": Quantity(0.1, 1.0, "1")}
    own = replace(finding(0.99, 1), parameters=sizes)
    assert doubts(diagnosis("missing-physics", own)) == []
    weak = replace(own, parameters={**sizes, "a": Quantity(2.0, 1.0, "1")})
    (text,) = doubts(diagnosis("missing-physics", weak))
    assert text.startswith("No amplitude of backlash at q1, q2 is twice its own uncertainty")
    assert doubts(diagnosis("missing-physics", replace(own, parameters={}))) == []
    raised = Alarm(9.0, 1e-4, "order", share=0.12)
    assert raised.raised
    (text,) = doubts(diagnosis("missing-physics", own, structure=raised))
    assert text.startswith("Residuals still follow the order of rows (p = 1.0×10⁻⁴; 12 % of them)")
    (text,) = doubts(diagnosis("missing-physics", own, structure=replace(raised, about="q2")))
    assert text.startswith("Residuals still follow q2 (p")
    assert doubts(diagnosis("adequate", structure=raised)) == []
    far = fits(1.0)
    far["after"] = SimpleNamespace(
        **{**vars(far["after"]), "worst_parameter": "q1.d", "worst_parameter_sigma": 4.0}
    )
    (text,) = doubts(diagnosis("missing-physics", own, fits=far, terms=("one",)))
    assert text.startswith("q1.d still stands 4.00 tolerances from its drawing, beyond the 3.00 that")
    assert doubts(diagnosis("missing-physics", own, fits=far)) == []
    hardly_seen = judged(4.0, 0.004, allowed=5.6e-6)
    assert doubts(diagnosis("missing-physics", own, fits=hardly_seen, terms=("one",))) == []


def judged(before: float, after: float, allowed: float = 3.0) -> dict[str, object]:
    """Fits whose farthest parameters stand so many tolerances away."""
    return {
        name: SimpleNamespace(
            chi2_per_dof=1.1, worst_parameter="q1.d", worst_parameter_sigma=far, worst_allowed=allowed
        )
        for name, far in (("before", before), ("after", after))
    }


@pytest.mark.parametrize(
    ("before", "after", "said_"),
    [(9.0, 2.0, "within the 3.00"), (2.5, 2.0, "within the 3.00"), (9.0, 4.0, "still above the 3.00"),
     (3.0, 3.0, "within the 3.00")],
)  # fmt: skip
def test_where_the_farthest_parameter_went(before: float, after: float, said_: str) -> None:
    found = diagnosis(
        "missing-physics", finding(0.99, 1), fits=judged(before, after), terms=("one",), alarms={}
    )
    (text,) = [one for one in reasons(found) if "tolerances from its drawing" in one]
    assert f"is q1.d at {after:.2f}, {said_} that a true model keeps to in 99 of 100 cases." in text
    endless = diagnosis(
        "missing-physics", finding(0.99, 1), fits=judged(9.0, 2.0, NAN), terms=("one",), alarms={}
    )
    assert "No parameter has a finite tolerance, so none can be judged against its drawing." in reasons(
        endless
    )


def test_reasons_of_a_finding_are_those_of_the_surest_and_of_rows_held_out() -> None:
    strong = replace(finding(0.99, 1), log_bayes_factor=60.0, effect="joint-compliance")
    alarms = {"residual": Alarm(1.0, 0.4), "structure": Alarm(9.0, 1e-4), "prior_conflict": Alarm(9.0, 1e-4)}
    found = diagnosis("missing-physics", finding(0.99, 1), strong, alarms=alarms, proof=proof())
    text = reasons(found)
    assert text[0].startswith(
        "The readings are 10²⁶ times likelier with a compliant joint (joint-compliance) at q1, q2"
    )
    assert text[0].endswith("(log Bayes factor 60.0).")
    assert text[1] == (
        "On the validation rows, never fitted, rms falls to 0.400 of what it was (95 % interval 0.300 to 0.500)."
    )
    assert text[2].endswith(": structure in residuals and conflict with tolerances.")
    turns = reasons(replace_proof(found, proof(held_out="blocks", ratio_interval=(0.3, 1.0))))
    assert turns[1].startswith("On rows held out in turn (blocks), never fitted,")
    assert turns[1].endswith(" That is no certain gain.")
    assert len(reasons(diagnosis("missing-physics", alarms={}))) == 0


@pytest.mark.parametrize(("disagreement", "told"), [(0.0, False), (AGREED, False), (1.01 * AGREED, True)])
def test_chains_that_differ_beyond_what_is_agreed_are_a_doubt(disagreement: float, told: bool) -> None:
    found = doubts(diagnosis("adequate", disagreement=disagreement))
    assert bool(found) is told
    assert all("are known to" in one and "so far do the chains differ" in one for one in found)


def test_rows_that_lie_far_out_are_no_explanation_that_was_weighed_best() -> None:
    rows = Alternative("outliers", ("7",), 0.9, 99.0)
    alone = reasons(diagnosis("adequate", alarms={}, candidates=(rows,)))
    assert not [text for text in alone if "weighed" in text]
    both = reasons(
        diagnosis("adequate", alarms={}, candidates=(rows, Alternative("backlash", ("q1",), 0.1, 0.5)))
    )
    assert both[-1].startswith("The best of 2 explanations weighed, backlash at q1, reaches")


def replace_proof(found: Any, other: Proof) -> Any:
    return SimpleNamespace(**{**vars(found), "proof": other})


def test_an_adequate_verdict_tells_quiet_alarms_and_the_best_that_was_weighed() -> None:
    alarms = {"residual": Alarm(1.0, 0.4), "structure": Alarm(9.0, 1e-4)}
    candidates = (
        Alternative("backlash", ("q1",), 0.1, 0.5),
        Alternative("joint-compliance", ("q2",), 0.1, 1.5),
    )
    text = reasons(diagnosis("adequate", alarms=alarms, candidates=candidates))
    assert text[0].startswith("With parameters held to their tolerances, misfit chi2/dof is 12.0;")
    assert text[1] == "Quiet: lack of fit."
    assert text[2].startswith("Raised: structure in residuals; but no explanation is likelier than none")
    assert text[3].startswith(
        "The best of 2 explanations weighed, compliant joint (joint-compliance) at q2, reaches a log Bayes factor of 1.50:"
    )
    assert len(reasons(diagnosis("adequate", alarms={}, candidates=()))) == 1


def test_noise_is_told_where_the_misfit_does_not_go_without_saying() -> None:
    told = "Beside all effects, noise of 1.40 stated sigmas is likeliest."
    off, calm = (
        diagnosis("unknown", fits=fits(chi2), noise=1.4, alarms={}, candidates=()) for chi2 in (1.9, 1.1)
    )
    assert told in reasons(off) and told not in reasons(calm)


MISFITS = [
    ("adequate", 1.9, 1.4, (), "a stated sigma that is too small (1.4 times): noise of that size"),
    ("adequate", 1.9, 1.0, (), "something missing: noise does not explain it"),
    ("unknown", 1.9, 1.4, (), "something missing"),
    ("missing-physics", 1.9, 1.4, ("name",), "for something smaller beside what is named"),
    ("missing-physics", 4.0, 1.4, ("name",), "something missing"),
    ("adequate", 0.5, 0.7, (), "a stated sigma that is too large (residuals are 0.71 of it)"),
    ("adequate", 0.5, 1.0, (), "a stated sigma that is too large"),
]


@pytest.mark.parametrize(("verdict", "chi2", "noise", "names", "reason"), MISFITS)
def test_a_misfit_far_from_noise_is_said_in_the_first_sentence(
    verdict: str, chi2: float, noise: float, names: tuple[str, ...], reason: str
) -> None:
    """In both directions, with what speaks for a misstated sigma and what for something missing."""
    findings = [finding(0.99, 1) for _ in names]
    found = diagnosis(verdict, *findings, fits=fits(chi2), noise=noise)
    first = headline(found)[0].partition(". ")[0]
    assert f"chi2 per degree of freedom {chi2:.2f}".rstrip("0") in first and reason in first


@pytest.mark.parametrize("chi2", [0.78, 1.0, 1.29, float("nan")])
def test_a_usual_misfit_is_not_worth_a_word(chi2: float) -> None:
    found = diagnosis("adequate", fits=fits(chi2), noise=1.0)
    assert "degree of freedom" not in headline(found)[0]


def test_the_headline_names_the_experiment_of_what_moves_the_tool_most() -> None:
    """Of findings whose law is sure it says nothing."""
    pairs = {"q1": 0.2, "q2": 0.9}
    asked = {
        name: OpenQuestion(
            (f"backlash@{name}:b=1e-3", f"empirical@{name}:degree=3"), f"move {name}; or wait", {}, mm
        )
        for name, mm in pairs.items()
    }
    open_ = [replace(finding(0.7, 1), place=(name,), question=one) for name, one in asked.items()]
    said = headline(diagnosis("missing-physics", *open_, finding(0.99, 1)))[0]
    assert said.endswith(" What would tell: move q2 (plan --discriminate backlash@q2 empirical@q2).")
    assert "What would tell" not in headline(diagnosis("missing-physics", finding(0.99, 1)))[0]
