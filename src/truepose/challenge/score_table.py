"""The table of an examination: Markdown for people, plain data for programs, lines for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from truepose.challenge.calibration import Bin, brier, reliability
from truepose.challenge.figures import Figure, details, grouped, headline
from truepose.challenge.schedule import NULL
from truepose.challenge.score import Score, Statement
from truepose.challenge.solutions import Truth

COLUMNS = ("detected", "named", "top effect", "top place", "exact")
_HEAD = """# Blind examination of the diagnosis: {n} cases

Recordings come from simulated machines that share nothing with the catalogue; the engine saw machine and recording only.
A size is in detection limits: sizes whose signal-to-noise ratio is 5 after geometry has adapted within its tolerances.

* **detected**: the verdict is not `adequate`. **named**: every true effect, or one that the data cannot tell from it, is
  in the class of some finding. **top**: the finding with the largest Bayes factor. **exact**: the findings are the true
  effects, one to one.
* What the data cannot tell from the truth is decided from the noise-free change of the readings: a catalogued effect,
  within its physical bounds, that leaves less than 6 of its chi2 when geometry adapts.
* **confident wrong name**: a probability of at least 0.95 in a finding whose class holds no true effect. **honest**:
  outside the library, something is said to be missing and no such name is given; stricter, no other name comes first at all.
* **held-out error**: of predicted readings against noise-free ones, in sigma, on later rows at the ends of the ranges.
  The oracle is the fit that is told effects and places. **bias**: rms error in tolerances of the combinations of
  constants that readings know better than the drawing.
* A crash, or a diagnosis that takes too long, is wrong everywhere. 95 % intervals are Wilson's for shares and
  bootstrap ones for medians."""


@dataclass(frozen=True)
class Table:
    """All figures of an examination and the scores that they come from; ``undrawn``: cases that a machine cannot offer."""

    scores: tuple[Score, ...]
    headline: tuple[Figure, ...]
    details: tuple[Figure, ...]
    machines: Mapping[str, tuple[Figure, ...]]
    effects: Mapping[str, tuple[Figure, ...]]
    undrawn: tuple[str, ...] = ()

    @property
    def statements(self) -> tuple[Statement, ...]:
        """Every name given, with its probability."""
        return tuple(x for s in self.scores for x in s.statements)

    @property
    def classes(self) -> tuple[Statement, ...]:
        """Every class given, with its certainty."""
        return tuple(x for s in self.scores for x in s.classes)


def table(scores: Sequence[Score], undrawn: Sequence[str] = ()) -> Table:
    """Everything that scores say together."""
    return Table(
        tuple(scores),
        headline(scores),
        details(scores),
        grouped(scores, lambda s: [s.solution.machine]),
        grouped(scores, lambda s: dict.fromkeys(t.effect for t in s.solution.truths)),
        tuple(undrawn),
    )


def lines(found: Table) -> list[str]:
    """The figures with targets, for a terminal without colours."""
    rows = [(f.name, _value(f), _interval(f), _target(f), _count(f)) for f in found.headline]
    widths = [max(len(row[k]) for row in rows) for k in range(5)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]


def markdown(found: Table) -> str:
    """The whole table: figures, groups, calibration, then every case in one line."""
    head = ("figure", "value", "95 %", "target", "cases")
    parts = [
        _HEAD.format(n=len(found.scores)),
        _grid(head, ((f.name, _value(f), _interval(f), _target(f), _count(f)) for f in found.headline)),
    ]
    body = ((f.name, _value(f), _interval(f), _count(f)) for f in found.details)
    parts += ["## By stratum", _grid(("figure", "value", "95 %", "cases"), body)]
    for title, groups in (("machine", found.machines), ("effect", found.effects)):
        rows = ((name, str(figures[0].n), *(_value(f) for f in figures)) for name, figures in groups.items())
        parts += [
            f"## By {title}",
            "Cases with effects of the library.",
            _grid((title, "cases", *COLUMNS), rows),
        ]
    parts += ["## Calibration", _calibration(found)]
    parts += ["## Every case", _key(), _grid(_CASE, (_case(s) for s in found.scores))]
    if found.undrawn:
        parts += ["Not drawn:", "\n".join(f"* {text}" for text in found.undrawn)]
    return "\n\n".join(parts) + "\n"


def document(found: Table) -> dict[str, Any]:
    """The same as plain data."""
    return {
        "schema": "truepose/challenge/1",
        "cases": len(found.scores),
        "figures": [_figure(f) for f in found.headline],
        "details": [_figure(f) for f in found.details],
        "machines": {name: [_figure(f) for f in fs] for name, fs in found.machines.items()},
        "effects": {name: [_figure(f) for f in fs] for name, fs in found.effects.items()},
        "brier": {"names": brier(found.statements), "classes": brier(found.classes)},
        "reliability": {
            "names": [_bin(b) for b in reliability(found.statements)],
            "classes": [_bin(b) for b in reliability(found.classes)],
        },
        "scores": [_score(s) for s in found.scores],
        "undrawn": list(found.undrawn),
    }


def _calibration(found: Table) -> str:
    rows = []
    for what, statements in (("names", found.statements), ("classes", found.classes)):
        rows += [
            (what, f"{b.said:.2f}", str(b.n), f"{100 * b.hits / b.n:.0f} %", _ends(b.interval))
            for b in reliability(statements)
        ]
    scores = ", ".join(
        f"{what} {value:.3f}"
        for what, value in (("names", brier(found.statements)), ("classes", brier(found.classes)))
        if value is not None
    )
    grid = _grid(("statement", "said", "n", "right", "95 %"), rows)
    meaning = "A name is right when it is the very truth, a class when it holds it."
    return f"Brier score: {scores or 'no statement'}. {meaning}\n\n{grid}"


_CASE = (
    "case",
    "machine",
    "stratum",
    "truth (size in limits)",
    "free chi2/dof",
    "said",
    "held-out",
    "s",
    "right",
)


def _key() -> str:
    return (
        "Held-out: the engine's error over the oracle's. Said: verdict, then names with their own probability; "
        "what stands beside a name as its equivalent is in `results/`."
    )


def _case(s: Score) -> tuple[str, ...]:
    sol = s.solution
    stratum = f"{sol.stratum}: {sol.variant}" if sol.variant else sol.stratum
    truth = "; ".join(_truth(t) for t in sol.truths) or "-"
    ratio = "-" if s.held_out_ratio is None else f"{s.held_out_ratio:.2f}"
    said = f"{s.said} ({s.failure})" if s.failure else s.said
    mark = "yes" if s.right else "class" if s.named and sol.stratum != NULL else "no"
    hidden = " concealed" if sol.concealed else ""
    chi2 = f"{sol.free_chi2_per_dof:.2f}{hidden}"
    return (sol.case, sol.machine, stratum, truth, chi2, said, ratio, f"{s.seconds:.0f}", mark)


def _truth(t: Truth) -> str:
    return f"{t.effect or t.kind}@{'+'.join(t.place)} ({t.factor:.1f})"


def _grid(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    out = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    out += ["| " + " | ".join(cell.replace("|", "/") for cell in row) + " |" for row in rows]
    return "\n".join(out)


def _value(f: Figure) -> str:
    if f.value is None:
        return "-"
    return f"{100 * f.value:.0f} %" if f.share else f"{f.value:.2f}"


def _interval(f: Figure) -> str:
    if f.interval is None:
        return "-"
    return _ends(f.interval) if f.share else f"{f.interval[0]:.2f} to {f.interval[1]:.2f}"


def _ends(interval: tuple[float, float]) -> str:
    return f"{100 * interval[0]:.0f} to {100 * interval[1]:.0f} %"


def _target(f: Figure) -> str:
    if f.target is None:
        return ""
    sense = "at least" if f.target.least else "at most"
    wanted = f"{100 * f.target.value:.0f} %" if f.share else f"{f.target.value:g}"
    return f"{sense} {wanted}" + ("" if f.met is None else ": reached" if f.met else ": missed")


def _count(f: Figure) -> str:
    return f"{f.hits} of {f.n}" if f.share else str(f.n)


def _figure(f: Figure) -> dict[str, Any]:
    target = f.target and {"value": f.target.value, "sense": ">=" if f.target.least else "<="}
    out: dict[str, Any] = {
        "name": f.name,
        "n": f.n,
        "value": f.value,
        "interval": f.interval and list(f.interval),
    }
    return {**out, **({"hits": f.hits} if f.share else {}), "target": target, "met": f.met}


def _bin(b: Bin) -> dict[str, Any]:
    return {"said": b.said, "n": b.n, "hits": b.hits, "interval": list(b.interval)}


_KEPT = (
    *(
        "said",
        "failure",
        "seconds",
        "right",
        "verdict",
        "detected",
        "named",
        "top_effect",
        "top_place",
        "exact",
    ),
    *(
        "confident_wrong",
        "wrong_class",
        "honest",
        "abstained",
        "flag",
        "held_out",
        "held_out_ratio",
        "bias",
        "bias_ratio",
    ),
)


def _score(s: Score) -> dict[str, Any]:
    sol = s.solution
    about = {"case": sol.case, "machine": sol.machine, "stratum": sol.stratum, "variant": sol.variant}
    shown = ("effect", "kind", "place", "factor", "snr", "misfit")
    truths = [{name: getattr(t, name) for name in shown} for t in sol.truths]
    return {
        **about,
        "truths": truths,
        "concealed": sol.concealed,
        **{name: getattr(s, name) for name in _KEPT},
    }


__all__ = ["Table", "document", "lines", "markdown", "table"]
