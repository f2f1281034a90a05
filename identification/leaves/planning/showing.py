"""Plans and experiments as they show themselves: tables with joints in the units of the machine file, lines, notes, JSON.

What a planned experiment is expected to tell, in words and as JSON.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from truepose.arrays import Array
from truepose.identification.leaves.planning.criterion import CRITERION, TITLE
from truepose.identification.leaves.planning.discriminate.experiment import SPLIT, Experiment, Pair
from truepose.identification.leaves.planning.information import decimals
from truepose.identification.leaves.planning.plan import Plan
from truepose.identification.report.notes import worded
from truepose.models.file.driver import APPROACH, SESSION, TIME, Driver
from truepose.models.machine.machine import Machine
from truepose.models.units import convert
from truepose.shown.document import Document, Items, Table
from truepose.shown.result import document, frame
from truepose.wording import joined

# -- What a planned experiment is expected to tell, in words and as JSON


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
        "random": _random_json(found.random),
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


def _random_json(values: Array) -> dict[str, float]:
    return {"mean": float(np.mean(values)), "std": float(np.std(values)), "sets": len(values)}


def _pair_json(pair: Pair) -> dict[str, Any]:
    said = {name: getattr(pair, name) for name in ("expected", "separable", "identical", "twins")}
    return {"true": pair.true.name, "rival": pair.rival.name, **said}


# -- Plans and experiments as they show themselves: tables with joints in the units of the machine file, lines, notes, JSON

_FINEST = 1e-12
BETWEEN = 30.0
"""Seconds from one row to the next, where time is planned."""


@frame.register
def plan_table(plan: Plan) -> pd.DataFrame:
    """``pose``, ``from`` where readings are changes, and the joints, in the units of the machine file.

    Rows of the same joint values share a ``pose`` number: they are repeats.
    """
    n = len(plan.q)
    data: dict[str, Array | NDArray[np.int64]] = {}
    if plan.origin is None:
        data["pose"] = _numbered(plan.q)
    else:  # the number says which row a change counts from
        data["pose"], data["from"] = np.arange(1, n + 1), plan.origin.astype(np.int64) + 1
    return pd.DataFrame({**data, **_joints(plan.q, plan.machine)})


@frame.register
def experiment_table(experiment: Experiment) -> pd.DataFrame:
    """``pose``, ``from`` where readings are changes (all from the first row, a reference), ``session`` and ``time``
    where they matter, the joints, then payload (kg), temperatures (degC), sides and other drivers.

    Rows of one pose share a number when nothing but the side of approach differs: they are repeats.
    """
    rows, machine = experiment.rows, experiment.machine
    q, drivers = rows.q, dict(rows.drivers)
    data: dict[str, Array | NDArray[np.int64]] = {}
    if experiment.reference is None:
        held = [values for name, values in drivers.items() if Driver.of(name).kind not in (APPROACH, TIME)]
        data["pose"] = _numbered(np.column_stack([q, *held]))
    else:
        q = np.concatenate([experiment.reference[None], q])
        drivers = {name: np.concatenate([values[:1], values]) for name, values in drivers.items()}
        data["pose"], data["from"] = np.arange(1, len(q) + 1), np.ones(len(q), dtype=np.int64)
    if SESSION in drivers:
        data[SESSION] = drivers.pop(SESSION).astype(np.int64)
    if TIME in drivers:
        data[TIME] = _one_by_one(drivers.pop(TIME))
    data |= _joints(q, machine)
    joints = machine.mechanism.reading_units
    columns = {name: machine.column_unit(name) for name in joints}
    for name, values in drivers.items():
        known, driver = machine.declared(name), Driver.of(name)
        units = (known.unit, known.written) if known else (driver.unit(joints), driver.unit(columns))
        written = convert(values, *units) if all(units) else values
        data[name] = np.round(written, decimals(written, _FINEST)) + 0.0
    return pd.DataFrame(data)


def _joints(q: Array, machine: Machine) -> dict[str, Array | NDArray[np.int64]]:
    """Joint values (n, nq) by column, in the units of the machine file."""
    data: dict[str, Array | NDArray[np.int64]] = {}
    for k, actuator in enumerate(machine.mechanism.actuators):
        written = convert(q[:, k], actuator.reading_unit, machine.column_unit(actuator.reading))
        # what is left of the conversion's rounding would make long numbers of short ones
        data[actuator.reading] = np.round(written, decimals(written, _FINEST)) + 0.0
    return data


def _one_by_one(time: Array) -> Array:
    """Times (n,), ascending, of rows that are due at once: one after the other."""
    first = np.searchsorted(time, time)
    return np.asarray(time + BETWEEN * (np.arange(len(time)) - first))


def _numbered(q: Array) -> NDArray[np.int64]:
    """(n,) numbers from 1 in order of appearance, the same for the same joint values."""
    _, first, group = np.unique(q, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return np.asarray(1 + rank[group.reshape(-1)], dtype=np.int64)


CROWDED = 0.02
"""Poses closer than this, in shares of the ranges, are as good as repeats."""


def plan_lines(found: Plan) -> list[str]:
    """What was reached, against random poses."""
    by_exchange = "" if found.by_exchange is None else f"; by exchange {found.by_exchange:.4f}"
    lines = [
        f"criterion {CRITERION}: {TITLE} = {found.value:.4f}; random poses {np.mean(found.random):.4f} +- "
        f"{np.std(found.random):.4f} ({len(found.random)} sets){by_exchange}"
    ]
    if found.shrinkage is not None:
        lines.append(
            f"1-sigma of the {found.determined} determined directions: {found.shrinkage:.3f} of what random poses "
            "leave (geometric mean)"
        )
    return lines


def plan_notes(found: Plan) -> list[str]:
    """What the plan leaves out, and poses that crowd."""
    notes = []
    unplanned = dict.fromkeys(
        Driver.of(name).now.name for effect in found.machine.effects for name in effect.drivers
    )
    notes += [
        f"{name!r} is not planned: effects that depend on it count at its default" for name in unplanned
    ]
    if found.left_out:
        notes.append(f"{found.left_out} candidates were left out: not assembled, or next to a singularity")
    alike = found.repeats(CROWDED)
    if 2 * alike >= len(found.q):
        notes.append(
            f"{alike} of {len(found.q)} poses repeat others within {CROWDED:.0%} of the ranges: best for the constants "
            "of this file, but blind to physics that it lacks; --method exchange spreads them"
        )
    return notes


def plan_json(found: Plan, columns: Sequence[str]) -> dict[str, object]:
    """The same as data; ``columns`` are those of the poses' table."""
    indices = {f"O{k}": float(getattr(found.indices, f"o{k}")) for k in range(1, 6)}
    return {
        "machine": found.machine.name,
        "method": found.method,
        "criterion": CRITERION,
        "seed": found.seed,
        "poses": len(found.q),
        "columns": list(columns),
        "value": found.value,
        "random": _random_json(found.random),
        "exchange": found.by_exchange,
        "repeats": found.repeats(CROWDED),
        "determined": found.determined,
        "shrinkage": found.shrinkage,
        "observability": indices,
    }


_UNITS = "in the units of the machine file"


@document.register
def _(found: Plan) -> Document:
    return Document(
        "Plan",
        f"Plan of {len(found.q)} poses to calibrate {found.machine.name}: {found.method}, seed {found.seed}",
        summary=[Items(plan_lines(found)), Table.of(frame(found))],
        notes=plan_notes(found),
        more=f"to_frame() has all poses, {_UNITS}",
    )


@document.register
def _(found: Experiment) -> Document:
    table = frame(found)
    return Document(
        "Experiment",
        f"Experiment of {len(table)} rows on {found.machine.name}, seed {found.seed}",
        summary=[Items(sentences(found)), Table.of(table)],
        notes=worded(found.notes),
        more=f"to_frame() has all rows, {_UNITS}",
    )
