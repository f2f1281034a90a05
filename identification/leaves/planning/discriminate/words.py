"""What a planned experiment is expected to tell, in words and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from truepose.identification.leaves.planning.discriminate.experiment import SPLIT, Experiment, Pair
from truepose.wording import joined


def sentences(found: Experiment) -> list[str]:
    """Lines for the terminal, the verdict first."""
    out = [*_verdict(found), _against_chance(found)]
    out += [_pair(pair) for pair in sorted(found.pairs, key=lambda p: p.expected)[:6]]
    return [line for line in out if line]


def experiment_json(found: Experiment) -> dict[str, Any]:
    """The same as data."""
    return {
        "criterion": "expected log Bayes factor of the worst pair that can be told apart",
        "explanations": [e.name for e in found.explanations],
        "expected": found.expected,
        "split": found.splits,
        "threshold": SPLIT,
        "inseparable": [[p.true.name, p.rival.name] for p in found.stuck],
        "already": found.already,
        "random": {
            "mean": float(np.mean(found.random)),
            "std": float(np.std(found.random)),
            "sets": len(found.random),
        },
        "pairs": [_pair_json(pair) for pair in found.pairs],
        "sentences": sentences(found),
    }


def _verdict(found: Experiment) -> list[str]:
    """Whether the class will be split; pairs that nothing on offer tells apart come after."""
    lost = [_stuck(pair, found.held) for pair in found.stuck]
    if found.hopeless:
        return lost
    names = joined(e.name for e in found.explanations)
    apart = "apart" if not lost else "apart as far as they can be told"
    value = f"expected log Bayes factor {found.expected:.3g}"
    if found.expected >= SPLIT:
        first = f"these {len(found.rows)} rows are expected to tell {names} {apart}: {value} (3 decides)"
    else:
        first = (
            f"these {len(found.rows)} rows are not expected to tell {names} {apart}: {value}, 3 decides; "
            f"{_more(found)}"
        )
    return [first, *lost]


def _more(found: Experiment) -> str:
    """What else could help where rows alone do not."""
    if found.held:
        return f"{joined(found.held)} was left at its nominal value: offer levels of it"
    if found.expected > 0.5:
        return f"about {int(np.ceil(SPLIT / found.expected * len(found.rows)))} rows like these would"
    return "a size as small as this needs another instrument"


def _stuck(pair: Pair, held: Sequence[str]) -> str:
    """A pair that nothing offered tells apart, and what would."""
    a, b = pair.true.name, pair.rival.name
    if held and not pair.twins:
        return (
            f"nothing that is offered tells {a} from {b} (expected log Bayes factor 0); {joined(held)} was left at its nominal"
            " value: offer levels of it"
        )
    if pair.identical:
        reason = "do the same to every reading of this sensor, whatever the poses"
    else:
        reason = "cannot be told apart at this size by any of the rows that may be taken"
    told = [f"{e.slug}: {e.experiment}" for e in (pair.true, pair.rival) if e.experiment]
    other = "; ".join(dict.fromkeys(told)) or "read one of them with an instrument of its own"
    return f"{a} and {b} {reason}: no plan splits them (expected log Bayes factor 0). What would: {other}"


def _against_chance(found: Experiment) -> str:
    if found.hopeless:
        return ""
    exists = "" if found.already is None else f"; the rows that exist already: {found.already:.3g}"
    return (
        f"as many random rows: {np.mean(found.random):.3g} +- {np.std(found.random):.2g} ({len(found.random)} sets)"
        f"{exists}"
    )


def _pair(pair: Pair) -> str:
    if not pair.separable:
        return ""
    return f"if {pair.true.name} is true, against {pair.rival.name}: {pair.expected:.3g}"


def _pair_json(pair: Pair) -> dict[str, Any]:
    return {
        "true": pair.true.name,
        "rival": pair.rival.name,
        "expected": pair.expected,
        "separable": pair.separable,
        "identical": pair.identical,
        "twins": pair.twins,
    }
