"""How a diagnosis did on one case. Everything follows from the key and the engine's files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from challenge import solutions
from challenge.examinee import DIAGNOSIS
from challenge.findings import FORM, Found, Judge, Reply, read_reply
from challenge.levels import AtLevels, judged
from challenge.measures import parameter_bias
from challenge.predictions import Predicted, read_prediction
from challenge.schedule import NULL, OUTSIDE, REAL
from challenge.solutions import CONCEALED, Solution
from challenge.statements import (
    SURE,
    Rows,
    Statement,
    classes_said,
    inclusion_said,
    names_said,
    rows_judged,
    rows_said,
)
from truepose.models.effects.common import OF_ROWS

CONFIDENT = 0.95
LARGE = 5.0
"""Detection limits from which on an effect should be found."""


@dataclass(frozen=True)
class Score:
    """One case: what was right. None where a question does not arise.

    verdict; named: every true effect is in the class of some finding; top_effect, top_place: of the best
    supported finding; first: its very name is true, or as good; exact: the findings are the true effects, one to one;
    confident_wrong: a name of at least 0.95 whose class holds no truth; wrong_class: a class of at least 0.95 that holds
    none. Of effects outside the library, if something was detected: honest: nothing is confident_wrong; abstained: the
    first name, if any, is as good as the truth. flag: ``concealed`` is right; held_out, bias: errors of the engine;
    held_out_ratio: over the oracle's; empirical_ratio: over that of the best model without names of as many columns;
    bias_ratio: the ordinary fit's over it; found: for each true effect whether some finding's class holds it; remainder:
    whether something unnamed was said; rows: which were set aside. statements, classes, aside, listed: names, classes,
    findings on rows and the whole list of effects, with their probabilities. A finding of outliers where none were put in is
    a name that is wrong; one without a law is no name. levels: places, drivers and laws.
    """

    solution: Solution
    said: str
    failure: str
    seconds: float
    verdict: bool = False
    detected: bool = False
    named: bool = False
    top_effect: bool = False
    top_place: bool = False
    first: bool = False
    exact: bool = False
    confident_wrong: bool = False
    wrong_class: bool = False
    honest: bool | None = None
    abstained: bool | None = None
    flag: bool | None = None
    predicted: Predicted = field(default_factory=Predicted)
    held_out_ratio: float | None = None
    empirical_ratio: float | None = None
    bias: float | None = None
    bias_ratio: float | None = None
    found: tuple[bool, ...] = ()
    remainder: bool = False
    rows: Rows = field(default_factory=Rows)
    statements: tuple[Statement, ...] = ()
    classes: tuple[Statement, ...] = ()
    aside: tuple[Statement, ...] = ()
    listed: tuple[Statement, ...] = ()
    levels: AtLevels = field(default_factory=AtLevels)
    answered: bool = True

    @property
    def held_out(self) -> float | None:
        """Error of predicted held-out readings, in sigma."""
        return self.predicted.error

    @property
    def pose_ratio(self) -> float | None:
        """Error of the tool's points on held-out rows over that of plain calibration."""
        return self.predicted.pose_ratio

    @property
    def right(self) -> bool:
        """Whether the case as a whole was answered well."""
        stratum = self.solution.stratum
        if stratum == NULL:
            return not self.detected and not self.failure
        if stratum == REAL:
            sure = all(s.right for s in self.statements if s.probability >= SURE)
            return sure and self.detected and all(hit for hit, _ in self.large)
        return bool(self.honest) if stratum == OUTSIDE else self.exact

    @property
    def large(self) -> tuple[tuple[bool, solutions.Truth], ...]:
        """Effects above 5 detection limits, and whether each was named."""
        hits = self.found or (False,) * len(self.solution.truths)
        pairs = zip(hits, self.solution.truths, strict=True)
        return tuple((hit, truth) for hit, truth in pairs if truth.factor > LARGE)

    @property
    def large_known(self) -> tuple[bool, ...]:
        """The same effects: whether the place and driver of each were said for sure."""
        known = self.levels.known or (False,) * len(self.solution.truths)
        pairs = zip(known, self.solution.truths, strict=True)
        return tuple(hit for hit, truth in pairs if truth.factor > LARGE)

    @property
    def factor(self) -> float:
        """Size of the smallest effect in detection limits; 0 without any."""
        return min((truth.factor for truth in self.solution.truths), default=0.0)


def score(
    solution: Solution,
    reply: Reply | None,
    *,
    predicted: Predicted | None = None,
    seconds: float = 0.0,
    failure: str = "",
) -> Score:
    """Compare a reply with the key; no reply is a failure, and nothing about it is right."""
    if reply is None:
        return _unanswered(solution, seconds, failure)
    predicted = predicted or Predicted()
    bias = parameter_bias(reply.parameters, solution.geometry)
    return replace(
        _judged(solution, reply),
        failure=failure,
        seconds=seconds,
        predicted=predicted,
        held_out_ratio=_ratio(predicted.error, solution.oracle.held_out if solution.oracle else None),
        empirical_ratio=_empirical_ratio(predicted, solution),
        bias=bias,
        bias_ratio=_ratio(solution.before.bias if solution.before else None, bias),
    )


def _judged(solution: Solution, reply: Reply) -> Score:
    """What was said, against what is true."""
    judge, truths = Judge(solution), solution.truths
    counted = _counted(reply, solution)
    physics = tuple(f for f in counted if f.name.effect != FORM)
    top, outside = physics[:1], solution.stratum == OUTSIDE
    detected = reply.verdict != "adequate" or (_row_effect(solution) and bool(physics))
    lost = [f for f in physics if not any(judge.covers(f, t) for t in truths)]
    wrong = any(_confident(f) for f in lost)
    held = tuple(any(judge.covers(f, t) for f in physics) for t in truths)
    on_rows = () if _row_effect(solution) else rows_said(reply, solution)
    return Score(
        solution=solution,
        said=_words(reply),
        failure="",
        seconds=0.0,
        verdict=_right_verdict(solution, reply, detected),
        detected=detected,
        named=bool(truths) and all(held),
        top_effect=any(judge.right_effect(f.name, t) for f in top for t in truths),
        top_place=any(judge.right_place(f.name, t) for f in top for t in truths),
        first=any(judge.names(f.name) or judge.as_good(f.name) for f in top),
        exact=_exact(judge, physics),
        confident_wrong=wrong,
        wrong_class=any(f.certainty >= CONFIDENT for f in lost),
        honest=(detected and not wrong) if outside else None,
        abstained=(detected and all(judge.as_good(f.name) for f in top)) if outside else None,
        flag=_flag(solution, reply) if detected and truths else None,
        found=held,
        remainder=reply.remainder,
        rows=rows_judged(reply, solution),
        statements=(*names_said(judge, physics), *(on_rows if not solution.wild else ())),
        classes=classes_said(judge, physics),
        aside=on_rows,
        listed=inclusion_said(judge, reply),
        levels=judged(judge, reply, counted),
    )


def _unanswered(solution: Solution, seconds: float, failure: str) -> Score:
    """Nothing is right; on a machine without a fault it counts as a false alarm."""
    no = False if solution.stratum == OUTSIDE else None
    return Score(
        solution,
        "no diagnosis",
        failure or "no diagnosis",
        seconds,
        detected=solution.stratum == NULL,
        honest=no,
        abstained=no,
        found=(False,) * len(solution.truths),
        answered=False,
    )


def read_score(drawn: Path, results: Path, case: str) -> Score:
    """The score of a case that was sat: its key in the folder of drawn cases, its results in that of an examination."""
    solution = solutions.from_file(drawn / "answers" / f"{case}.json")
    own = results / "results" / case
    about = json.loads((own / "run.json").read_text(encoding="utf-8"))
    return score(
        solution,
        read_reply(own / DIAGNOSIS),
        predicted=read_prediction(own, solution),
        seconds=float(about["seconds"]),
        failure=str(about["message"]),
    )


def _row_effect(solution: Solution) -> bool:
    return any(truth.effect in OF_ROWS for truth in solution.truths)


def _counted(reply: Reply, solution: Solution) -> tuple[Found, ...]:
    """Findings that are judged: those on rows only where such an effect was put in."""
    return reply.findings if _row_effect(solution) else reply.physics


def _confident(found: Found) -> bool:
    return any(said.probability >= CONFIDENT for said in found.members)


def _flag(solution: Solution, reply: Reply) -> bool | None:
    """Whether ``concealed`` is right; None where the free fit to first order and the product's own differ about it."""
    sides = [c for c in (solution.free_chi2_linear, solution.free_chi2_per_dof) if c is not None]
    if len({chi2 < CONCEALED for chi2 in sides}) > 1:
        return None
    return reply.concealed == solution.concealed


def _right_verdict(solution: Solution, reply: Reply, detected: bool) -> bool:
    if solution.stratum == NULL or all(t.effect in OF_ROWS for t in solution.truths):
        return reply.verdict == "adequate"
    if solution.stratum == OUTSIDE:
        acceptable = any(truth.equivalents for truth in solution.truths)
        nameless = bool(reply.physics) and not reply.named
        return reply.verdict == "unknown" or (detected and (acceptable or nameless))
    return reply.verdict == "missing-physics"


def _exact(judge: Judge, found: Sequence[Found]) -> bool:
    """Whether findings and truths match one to one; the places of one truth may be found one by one."""
    truths = list(judge.truths)
    if not truths or not found:
        return False
    return _matched(judge, list(found), truths)


def _matched(judge: Judge, found: list[Found], truths: list[solutions.Truth]) -> bool:
    if not truths:
        return not found
    truth, rest = truths[0], truths[1:]
    for k, one in enumerate(found):
        if judge.right(one.name, truth) and _matched(judge, found[:k] + found[k + 1 :], rest):
            return True
    parts = [f for f in found if judge.part(f.name, truth)]
    together = frozenset[str]().union(*(judge.place(f.name.place) for f in parts))
    whole = bool(parts) and together == judge.place(truth.place)
    return whole and _matched(judge, [f for f in found if f not in parts], rest)


def _ratio(over: float | None, under: float | None) -> float | None:
    return None if over is None or not under else over / under


def _empirical_ratio(predicted: Predicted, solution: Solution) -> float | None:
    if not solution.empirical or predicted.columns is None:
        return None
    allowed = min(predicted.columns, len(solution.empirical) - 1)
    return _ratio(predicted.error, solution.empirical[allowed])


def _words(reply: Reply) -> str:
    """The verdict and what was named."""
    names = [_word(f) for f in reply.findings]
    return reply.verdict + (": " + "; ".join(names) if names else "")


def _word(found: Found) -> str:
    """A name, or what drives something without one, with its probability."""
    what, probability = found.name.effect, found.name.probability
    if what == FORM and found.levels is not None:
        what, probability = f"something by {found.levels.kind}", found.levels.driver
    return f"{what}@{'+'.join(found.name.place)} {probability:.2f}"


__all__ = ["Score", "read_score", "score"]
