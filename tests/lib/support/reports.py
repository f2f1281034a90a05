"""A diagnosis made up for reports: an arm, estimates, one finding; and what a report's page says and holds."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from support.recordings import rows_of
from truepose.identification.diagnosis.result import (
    Alarm,
    Alternative,
    BlockProof,
    Diagnosis,
    Finding,
    OpenQuestion,
    Proof,
    Quantity,
    Replication,
    SetOfEffects,
)
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.leastsquares import Solution, Status
from truepose.identification.fit.problem import prior_of
from truepose.identification.fit.summary import FitSummary
from truepose.identification.recording.recording import Recording
from truepose.identification.report.diagnosis import diagnosis_document
from truepose.identification.signatures.untestable import Untestable
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.shown.document import Items
from truepose.shown.html import page
from truepose.shown.result import Shown, document
from truepose.shown.text import LINES, first_screen

Kind = TypeVar("Kind")
NAN = float("nan")
ROWS = 30
MACHINE = """
schema: truepose/machine/1
name: arm
units: {length: mm, angle: deg}
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, d: 50, range: [-170, 170], gear_ratio: 121}
    - {name: q2, kind: revolute, alpha: 90, d: 150, range: [-90, 90]}
frames: {tool: {in: flange, xyz: [300, 0, 40], rpy: [0, 0, 0], tolerance: {xyz: 1, rpy: 1}}}
sensor: {type: position, sigma: {xyz: 0.01}}
tolerances: {length: 0.1, angle: 0.1}
"""


def arm(folder: Path) -> Machine:
    path = folder / "arm.yaml"
    path.write_text(MACHINE)
    return load_machine(path)


def recorded(machine: Machine, rows: int = ROWS) -> Recording:
    rng = np.random.default_rng(1)
    q = rng.uniform(-1.5, 1.5, (rows, len(machine.mechanism.readings)))
    columns = [name for sensor in machine.sensors for name in sensor.columns]
    return rows_of(
        q,
        joints=machine.mechanism.readings,
        observations={name: rng.normal(size=rows) for name in columns},
        drivers={"temperature.base": 20 + rng.normal(size=rows)},
        files=("a&b.csv",),
        session_recorded=np.zeros(rows, dtype=bool),
        validation=np.arange(rows) >= rows - 5,
        time=None,
    )


def fitted(
    machine: Machine, recording: Recording, terms: tuple[PlacedEffect, ...] = (), away: float = 1.0
) -> Estimate:
    rng = np.random.default_rng(2)
    prior = prior_of(machine, terms)
    values = [a for term in terms for a in term.amplitudes]
    known = len(machine.parameters)
    p = prior.mean.copy()
    p[:known] += (
        away * rng.normal(size=known) * np.where(np.isfinite(prior.sigma[:known]), prior.sigma[:known], 0.0)
    )
    p[known:] = values
    free = len(prior.free)
    factor = np.triu(rng.normal(size=(free + 1, free + 1)) + 5 * np.eye(free + 1))
    factor[:, 1] = 0.0  # one direction is blind
    return Estimate(
        nominal=machine,
        recording=recording,
        effects=terms,
        prior=prior,
        p=p,
        x=np.zeros((len(recording), 0)),
        residual=rng.normal(size=(len(recording), 3)),
        used=~recording.validation,
        weights=np.ones(len(recording)),
        factor=factor,
        solution=Solution(np.zeros(free), factor, 1.0, next(iter(Status)), 3, 0.0, np.zeros(free)),
        unassembled=(),
    )


def gear(machine: Machine) -> PlacedEffect:
    effect = effects.get("transmission-error", "test")()
    return PlacedEffect.at(effect, machine, ("q1",), {"order": 2.0}, {"a": 3e-4, "b": -1e-4})


def gear_finding() -> Finding:
    return Finding(
        effect="transmission-error",
        place=("q1",),
        probability=0.93,
        certainty=0.999,
        log_bayes_factor=120.0,
        equivalents=(Alternative("encoder-eccentricity", ("q1",), 0.06, 117.5, "turn the disc"),),
        parameters={"a": Quantity(3e-4, 1e-5, "rad"), "b": Quantity(-1e-4, NAN, "rad")},
        settings=({"order": 2.0},),
        flip_lambda=3.0,
        explanation="The gear of joint q1 turns unevenly.",
        experiment="sweep q1 alone",
        replication=Replication((0.97, 0.9), agree=True),
        question=OpenQuestion(
            ("transmission-error@q1:order=2,a=0.0003,b=-0.0001", "empirical@q1:from.q1=-1.5,to.q1=1.5"),
            "sweep q1 alone; and couple the gear at another tooth",
            {"temperature.base": (18.5, 20.0, 22.25)},
        ),
    )


def summary(chi2: float, worst: float) -> FitSummary:
    return FitSummary({"position": 0.012}, chi2, {"position": 0.013}, worst, "q1.d", 3.1)


CANDIDATES = (
    Alternative("transmission-error", ("q1",), 0.5, 120.0),
    Alternative("transmission-error", ("q1",), 0.4, 119.0),
    Alternative("actuator-scale", ("q2",), 0.0, NAN),
)
SETS = (
    SetOfEffects((("transmission-error", ("q1",)),), 0.6),
    SetOfEffects((("transmission-error", ("q1",)), ("empirical", ("q2",))), 0.3),
    SetOfEffects((), 0.01),
)
INCLUSION = (
    Alternative("transmission-error", ("q1",), 0.93, 0.0),
    Alternative("empirical", ("q2",), 0.3, 0.0),
)


def synthetic(machine: Machine, **changes: Any) -> Diagnosis:
    recording = recorded(machine)
    term = gear(machine)
    before = fitted(machine, recording, away=4.0)
    structure = Alarm(0.4, 0.5, "q2", share=0.1)
    found = Diagnosis(
        nominal=machine,
        recording=recording,
        verdict="missing-physics",
        concealed=True,
        alarms={
            "residual": Alarm(1.02, 0.4, "replicates"),
            "prior_conflict": Alarm(214.0, 1e-9, "tolerances"),
            "structure": structure,
        },
        alarms_after={"residual": Alarm(1.0, 0.5, "replicates"), "structure": structure},
        findings=(gear_finding(),),
        remainder=None,
        candidates=CANDIDATES,
        evidence_map={"q1": 120.0, "q2": -0.5, "base": float("-inf")},
        untestable=(Untestable("thermal-expansion", "no temperature.link1 column"),),
        free=fitted(machine, recording, away=60.0),
        before=before,
        after=fitted(machine, recording, (term,)),
        fits={"free": summary(1.02, 60.0), "before": summary(9.0, 12.0), "after": summary(1.01, 1.2)},
        proof=Proof("role", (BlockProof("outermost poses", 12, 0.5),), 0.4, (0.3, 0.5), -0.5, 0.97, True),
        terms=(term,),
        outlier_rows=(7, 19),
        noise=1.0,
        inflation={},
        sets=SETS,
        inclusion=INCLUSION,
        disagreement=0.01,
    )
    return replace(found, **changes)


def own_markup(page: str) -> str:
    """The page without its scripts and styles, and without the marks of small type: what it says."""
    bare = re.sub(r"<(script|style)[^>]*>.*?</\1>", "", page, flags=re.DOTALL)
    return re.sub(r"</?(?:small|code)>", "", bare)


def page_data(page: str) -> dict[str, Any]:
    """The data that the page's scripts read."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return dict(json.loads(found[1]))


def of(items: Iterable[object], kind: type[Kind]) -> list[Kind]:
    """Those of a kind: blocks of a section, layers of a chart."""
    return [item for item in items if isinstance(item, kind)]


def report_html(found: Diagnosis, cautions: Sequence[str] | None = None) -> str:
    """The page of a diagnosis, below the cautions of a check where there was one."""
    told = diagnosis_document(found, checked=cautions is not None)
    return page(replace(told, cautions=cautions or ()))


def calibration_html(found: Calibration, cautions: Sequence[str] = ()) -> str:
    """The page of a calibration."""
    return page(replace(document(found), cautions=cautions))


def diagnosis_lines(
    found: Diagnosis, output: Path = Path("out"), most: int = LINES, **more: bool
) -> list[str]:
    """What ``truepose diagnose`` prints of a result."""
    return first_screen(diagnosis_document(found, output, **more), most)


def said_of(found: Shown) -> list[str]:
    """All sentences of the first screen, with the titles of their lists."""
    told = document(found)
    lists = [block for block in told.summary if isinstance(block, Items)]
    return [told.headline, *(text for block in lists for text in (block.title, *block.items))]
