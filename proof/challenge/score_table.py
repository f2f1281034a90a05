"""The table of an examination: Markdown for people, lines for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from challenge.calibration import brier, reliability
from challenge.details import details, grouped, named_at_once
from challenge.figures import Figure
from challenge.headline import headline
from challenge.schedule import NULL
from challenge.score import Score
from challenge.solutions import Truth
from challenge.statements import Statement

COLUMNS = ("detected", "named", "top effect", "top place", "exact")
HEAD = """# Blind examination of the diagnosis: {n} cases

Recordings come from simulated machines whose physics is computed another way than the catalogue's; the engine saw
machine and recording only. A size is in detection limits: sizes whose signal-to-noise ratio is 5 after geometry has adapted
within its tolerances, by the simulator's own derivatives, at the true sigma and tolerances. Half of the cases
state sigma wrong by up to 1.5 and tolerances by up to 2, and a few of their rows are wild.

* **detected**: the verdict is not `adequate`. **named**: every true effect, or one that the data cannot tell from it, is
  in the class of some finding. **first**, **top**: the finding with the largest Bayes factor. **exact**: the findings are
  the true effects, one to one.
* What the data cannot tell from the truth is decided from the noise-free change of the readings: a catalogued effect,
  within its physical bounds, that leaves less than 6 of its chi2 when geometry adapts.
* **confident wrong name**: a probability of at least 0.95 in a finding whose class holds no true effect. **honest**:
  outside the library, something is said to be missing and no such name is given; stricter, no other name comes first at all.
* **real-like**: 5 to 12 effects at once, families (one kind at all its places, in different sizes) and singles.
* **held-out error**: of predicted readings against noise-free ones, in sigma, on later rows at the ends of the ranges.
  The oracle is the fit that is told effects, places, wild rows, sigma and tolerances. The best empirical model knows no
  names: smooth curves at the joints and mounts, as many columns as the answer has coefficients, chosen by cross-validation.
  **bias**: rms error in tolerances of the combinations of constants that readings know better than the drawing.
* **place**, **driver**, **law**: a finding shares a part with the truth, or with what the data cannot tell from it; it also
  says what drives that (load, the joint's own position, the side of arrival, heat ...); it names that very effect. A finding
  may know the first two and no law: it is no name then, and outside the library an honest answer.
* **tool pose**: rms distance of the tool's points on the held-out rows from where a perfect instrument would see them, after
  a rigid refit, without what the models say of their sensor, over that of calibration without effects.
* **names** for calibration are all members of all classes, and outliers where no row is wild; right is the very truth alone;
  `unknown` is right where something without a name is at that part.
* A crash, or a diagnosis that takes too long, is wrong everywhere. 95 % intervals are Wilson's for shares, and by
  bootstrap over cases for the rest."""


@dataclass(frozen=True)
class Table:
    """All figures of an examination and the scores that they come from; ``undrawn``: cases that a machine cannot offer."""

    scores: tuple[Score, ...]
    headline: tuple[Figure, ...]
    details: tuple[Figure, ...]
    machines: Mapping[str, tuple[Figure, ...]]
    effects: Mapping[str, tuple[Figure, ...]]
    undrawn: tuple[str, ...] = ()
    at_once: Mapping[str, Figure] = field(default_factory=dict)
    simulators: Mapping[str, tuple[Figure, ...]] = field(default_factory=dict)

    @property
    def spoken(self) -> dict[str, tuple[Statement, ...]]:
        """What was said with probabilities, by sort."""
        sorts = {
            "names": [x for s in self.scores for x in s.statements],
            "names beside a remainder": [x for s in self.scores if s.remainder for x in s.statements],
            "places": [x for s in self.scores for x in s.levels.places],
            "places and drivers": [x for s in self.scores for x in s.levels.drivers],
            "laws": [x for s in self.scores for x in s.levels.laws],
            "classes": [x for s in self.scores for x in s.classes],
            "rows set aside": [x for s in self.scores for x in s.aside],
            "all effects listed": [x for s in self.scores for x in s.listed],
        }
        return {name: tuple(own) for name, own in sorts.items()}


def table(scores: Sequence[Score], undrawn: Sequence[str] = ()) -> Table:
    """Everything that scores say together."""
    return Table(
        tuple(scores),
        headline(scores),
        details(scores),
        grouped(scores, lambda s: [s.solution.machine]),
        grouped(scores, lambda s: dict.fromkeys(t.effect for t in s.solution.truths)),
        tuple(undrawn),
        named_at_once(scores),
        _by_simulator(scores),
    )


def _by_simulator(scores: Sequence[Score]) -> dict[str, tuple[Figure, ...]]:
    """The headline of each simulator's machines alone, where there are several."""
    names = dict.fromkeys(s.solution.simulator for s in scores)
    if len(names) < 2:
        return {}
    return {name: headline([s for s in scores if s.solution.simulator == name]) for name in names}


def lines(found: Table) -> list[str]:
    """The figures with targets, for a terminal without colours."""
    rows = [(f.name, _value(f), _interval(f), _target(f), _count(f)) for f in found.headline]
    widths = [max(len(row[k]) for row in rows) for k in range(5)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]


def markdown(found: Table) -> str:
    """The whole table: figures, groups, calibration, then every case in one line."""
    head = ("figure", "value", "95 %", "target", "n")
    parts = [
        HEAD.format(n=len(found.scores)),
        _grid(head, ((f.name, _value(f), _interval(f), _target(f), _count(f)) for f in found.headline)),
    ]
    for name, figures in found.simulators.items():
        some = ((f.name, _value(f), _interval(f), _target(f), _count(f)) for f in figures)
        parts += [f"## Machines of `{name}` alone", _grid(head, some)]
    body = ((f.name, _value(f), _interval(f), _count(f)) for f in found.details)
    parts += ["## By stratum", _grid(("figure", "value", "95 %", "n"), body)]
    for title, groups in (("machine", found.machines), ("effect", found.effects)):
        rows = ((name, str(figures[0].n), *(_value(f) for f in figures)) for name, figures in groups.items())
        parts += [
            f"## By {title}",
            "Cases with one or two effects of the library.",
            _grid((title, "cases", *COLUMNS), rows),
        ]
    named = ((name, _value(f), _interval(f), _count(f)) for name, f in found.at_once.items())
    parts += ["## Real-like cases: effects above 5 limits", _grid(("effect", "named", "95 %", "n"), named)]
    parts += ["## Calibration", _calibration(found)]
    parts += ["## Every case", KEY, _grid(_CASE, (_case(s) for s in found.scores))]
    if found.undrawn:
        parts += ["Not drawn:", "\n".join(f"* {text}" for text in found.undrawn)]
    return "\n\n".join(parts) + "\n"


def _calibration(found: Table) -> str:
    rows, scores = [], []
    for what, statements in found.spoken.items():
        rows += [
            (what, f"{b.said:.2f}", str(b.n), f"{100 * b.hits / b.n:.0f} %", _ends(b.interval), _yes(b.holds))
            for b in reliability(statements)
        ]
        value = brier(statements)
        scores += [f"{what} {value:.3f}"] if value is not None else []
    grid = _grid(("statement", "said", "n", "right", "95 %", "holds what was said"), rows)
    meaning = "A name is right when it is the very truth, a law and a class also when as good."
    return f"Brier score: {', '.join(scores) or 'no statement'}. {meaning}\n\n{grid}"


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
KEY = (
    "Held-out: the engine's error over the oracle's (out of the library: over the best empirical model's, marked e). Said: "
    "verdict, then names with their own probability; what stands beside a name as its equivalent is in `results/`. Sizes of "
    "real-like cases: in brackets what is left of them beside all other effects."
)


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _case(s: Score) -> tuple[str, ...]:
    sol = s.solution
    stratum = f"{sol.stratum}: {sol.variant}" if sol.variant else sol.stratum
    truth = "; ".join(_truth(t) for t in sol.truths) or "-"
    ratio = "-" if s.held_out_ratio is None else f"{s.held_out_ratio:.2f}"
    if s.held_out_ratio is None and s.empirical_ratio is not None and sol.truths:
        ratio = f"{s.empirical_ratio:.2f} e"
    said = f"{s.said} ({s.failure})" if s.failure else s.said
    mark = "yes" if s.right else "class" if s.named and sol.stratum != NULL else "no"
    hidden = " concealed" if sol.concealed else ""
    chi2 = sol.free_chi2_linear if sol.free_chi2_per_dof is None else sol.free_chi2_per_dof
    left = "-" if chi2 is None else f"{chi2:.2f}{hidden}"
    return (sol.case, sol.machine, stratum, truth, left, said, ratio, f"{s.seconds:.0f}", mark)


def _truth(t: Truth) -> str:
    faded = t.snr_beside is not None and t.factor_beside < 0.9 * t.factor
    beside = f" [{t.factor_beside:.1f}]" if faded else ""
    return f"{t.effect or t.kind}@{'+'.join(t.place)} ({t.factor:.1f}{beside})"


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
    low, high = (f"{100 * v:.0f} %" if f.share else f"{v:g}" for v in (f.target.low, f.target.high))
    if f.target.low == -float("inf"):
        wanted = f"at most {high}"
    else:
        wanted = f"at least {low}" if f.target.high == float("inf") else f"{low} to {high}"
    return wanted + ("" if f.met is None else ": reached" if f.met else ": missed")


def _count(f: Figure) -> str:
    return f"{f.hits} of {f.n}" if f.share else str(f.n)


__all__ = ["Table", "lines", "markdown", "table"]
