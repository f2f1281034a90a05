"""How a diagnosis did on one case. Everything follows from the key and the engine's files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from truepose.challenge import solutions
from truepose.challenge.examinee import DIAGNOSIS, PREDICTION
from truepose.challenge.findings import Found, Judge, Reply, read_reply
from truepose.challenge.measures import held_out_error, parameter_bias
from truepose.challenge.schedule import NULL, OUTSIDE
from truepose.challenge.solutions import Solution
from truepose.models.effects.of_rows import OF_ROWS

CONFIDENT = 0.95


@dataclass(frozen=True)
class Statement:
    """Something said with a probability, and whether it was so."""

    probability: float
    right: bool


@dataclass(frozen=True)
class Score:
    """One case: what was right. None where a question does not arise.

    verdict; named: every true effect is in the class of some finding; top_effect, top_place: of the best
    supported finding; exact: the findings are the true effects, one to one; confident_wrong: a name of at least
    0.95 whose class holds no truth; wrong_class: a class of at least 0.95 that holds none. Of effects outside the
    library, if something was detected: honest: nothing is confident_wrong; abstained: the first name, if any, is as
    good as the truth. flag: ``concealed`` is right; held_out, bias: errors of the engine; held_out_ratio: over the
    oracle's; bias_ratio: the ordinary fit's over it; statements, classes: names and classes with their probabilities.
    """

    solution: Solution
    said: str
    failure: str
    seconds: float
    verdict: bool
    detected: bool
    named: bool
    top_effect: bool
    top_place: bool
    exact: bool
    confident_wrong: bool
    wrong_class: bool
    honest: bool | None
    abstained: bool | None
    flag: bool | None
    held_out: float | None
    held_out_ratio: float | None
    bias: float | None
    bias_ratio: float | None
    statements: tuple[Statement, ...] = ()
    classes: tuple[Statement, ...] = ()

    @property
    def right(self) -> bool:
        """Whether the case as a whole was answered well."""
        if self.solution.stratum == NULL:
            return not self.detected and not self.failure
        return bool(self.honest) if self.solution.stratum == OUTSIDE else self.exact

    @property
    def factor(self) -> float:
        """Size of the smallest effect in detection limits; 0 without any."""
        return min((truth.factor for truth in self.solution.truths), default=0.0)


def score(
    solution: Solution,
    reply: Reply | None,
    *,
    held_out: float | None = None,
    seconds: float = 0.0,
    failure: str = "",
) -> Score:
    """Compare a reply with the key; no reply is a failure, and nothing about it is right."""
    if reply is None:
        return _unanswered(solution, seconds, failure)
    judge = Judge(solution)
    physics, truths = _counted(reply, solution), solution.truths
    top, outside = physics[:1], solution.stratum == OUTSIDE
    detected = reply.verdict != "adequate" or (_row_effect(solution) and bool(physics))
    wrong = [f for f in physics if _confident(f) and not any(judge.covers(f, t) for t in truths)]
    bias = parameter_bias(reply.parameters, solution.geometry)
    return Score(
        solution=solution,
        said=_words(reply),
        failure=failure,
        seconds=seconds,
        verdict=_right_verdict(solution, reply, detected),
        detected=detected,
        named=bool(truths) and all(any(judge.covers(f, t) for f in physics) for t in truths),
        top_effect=any(judge.right_effect(f.name, t) for f in top for t in truths),
        top_place=any(judge.right_place(f.name, t) for f in top for t in truths),
        exact=_exact(judge, physics),
        confident_wrong=bool(wrong),
        wrong_class=any(
            f.certainty >= CONFIDENT and not any(judge.covers(f, t) for t in truths) for f in physics
        ),
        honest=(detected and not wrong) if outside else None,
        abstained=detected and (not top or any(judge.right(f.name, t) for f in top for t in truths))
        if outside
        else None,
        flag=(reply.concealed == solution.concealed) if detected and truths else None,
        held_out=held_out,
        held_out_ratio=_ratio(held_out, solution.oracle.held_out if solution.oracle else None),
        bias=bias,
        bias_ratio=_ratio(solution.before.bias, bias),
        statements=tuple(
            Statement(said.probability, any(judge.true(said, t) for t in truths))
            for f in physics
            for said in f.members
        ),
        classes=tuple(Statement(f.certainty, any(judge.covers(f, t) for t in truths)) for f in physics),
    )


def _unanswered(solution: Solution, seconds: float, failure: str) -> Score:
    """Nothing is right; on a machine without a fault it counts as a false alarm."""
    null = solution.stratum == NULL
    no = False if solution.stratum == OUTSIDE else None
    return Score(
        solution, "no diagnosis", failure or "no diagnosis", seconds, False, null, False, False, False, False,
        False, False, no, no, None, None, None, None, None,
    )  # fmt: skip


def read_score(folder: Path, case: str) -> Score:
    """The score of a case that was sat: its key, its results."""
    solution = solutions.from_file(folder / "answers" / f"{case}.json")
    results = folder / "results" / case
    about = json.loads((results / "run.json").read_text(encoding="utf-8"))
    error = None
    if (results / PREDICTION).is_file():
        error = held_out_error(pd.read_csv(results / PREDICTION), solution.held_out)
    reply = read_reply(results / DIAGNOSIS)
    return score(
        solution, reply, held_out=error, seconds=float(about["seconds"]), failure=str(about["message"])
    )


def _row_effect(solution: Solution) -> bool:
    return any(truth.effect in OF_ROWS for truth in solution.truths)


def _counted(reply: Reply, solution: Solution) -> tuple[Found, ...]:
    """Findings that are judged: those on rows only where such an effect was put in."""
    return reply.findings if _row_effect(solution) else reply.physics


def _confident(found: Found) -> bool:
    return any(said.probability >= CONFIDENT for said in found.members)


def _right_verdict(solution: Solution, reply: Reply, detected: bool) -> bool:
    if solution.stratum == NULL or all(t.effect in OF_ROWS for t in solution.truths):
        return reply.verdict == "adequate"
    if solution.stratum == OUTSIDE:
        acceptable = any(truth.equivalents for truth in solution.truths)
        return reply.verdict == "unknown" or (acceptable and detected)
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


def _words(reply: Reply) -> str:
    """The verdict and what was named."""
    names = [f"{f.name.effect}@{'+'.join(f.name.place)} {f.name.probability:.2f}" for f in reply.findings]
    return reply.verdict + (": " + "; ".join(names) if names else "")


__all__ = ["Score", "Statement", "read_score", "score"]
