"""Diagnoses of a machine that is not there, for what is said of them: only what words are made from."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np

from truepose.identification.diagnosis.result import UNNAMED, Alarm, Alternative, Diagnosis, Finding, Quantity


def finding(probability: float, parameters: int) -> Finding:
    """One of so many parameters, with a rival that has a name and one that has none."""
    return Finding(
        effect="backlash",
        place=("q1", "q2"),
        probability=probability,
        certainty=0.99,
        log_bayes_factor=40.0,
        equivalents=(
            Alternative("friction-hysteresis", ("q2",), 0.1, 38.0),
            Alternative(UNNAMED, ("q2",), 0.01, 36.0),
        ),
        parameters={f"a{k}": Quantity(1.5 * k, 0.01, "mm" if k else "1") for k in range(parameters)},
        settings=({},),
        flip_lambda=None,
        explanation="They have play.",
        experiment="",
    )


def diagnosis(verdict: str, *findings: Finding, **others: object) -> Diagnosis:
    quiet: dict[str, object] = {
        "concealed": False,
        "remainder": None,
        "outlier_rows": (),
        "terms": (),
        "sets": (),
        "leading": (),
        "together": (),
        "untestable": (),
        "applied": None,
    }
    quiet |= {
        "proof": None,
        "disagreement": 0.0,
        "budget_spent": False,
        "stopped": False,
        "noise": 1.0,
        "inflation": {},
        "structure": Alarm(0.1, 0.5),
    }
    quiet |= {
        "missing": (),
        "before": still(),
        "after": still(),
        "fits": fits(1.01),
        "nominal": SimpleNamespace(name="arm", file=None, residual_units={"position": "mm"}),
        "verdict": verdict,
        "findings": findings,
    }
    return cast(Diagnosis, SimpleNamespace(**quiet | others))


def still() -> object:
    """A fit of nothing, which nothing speaks against."""
    prior = SimpleNamespace(names=(), free=np.zeros(0, dtype=int))
    machine = SimpleNamespace(parameters=(), frames=(), file=None)
    figures = {
        "effects": (),
        "p": np.zeros(0),
        "std": np.zeros(0),
        "in_tolerances": np.zeros(0),
        "slopes": np.zeros((0, 0)),
        "n_observations": 10,
        "chi2_per_dof": 1.0,
    }
    return SimpleNamespace(prior=prior, nominal=machine, fitted_effects=lambda: (), **figures)


def fits(after: float) -> dict[str, object]:
    one = {
        "worst_parameter_sigma": 1.0,
        "worst_allowed": 3.0,
        "rms": {"position": 0.03},
        "validation_rms": None,
    }
    return {
        name: SimpleNamespace(chi2_per_dof=chi2, **one)
        for name, chi2 in (("free", 1.0), ("before", 12.0), ("after", after))
    }
