"""Plans and experiments as they show themselves, and as tables."""

from __future__ import annotations

from functools import partial

import pandas as pd

from truepose.identification.leaves.planning.discriminate.experiment import Experiment
from truepose.identification.leaves.planning.discriminate.words import sentences
from truepose.identification.leaves.planning.plan import Plan
from truepose.identification.leaves.planning.pose_tables import experiment_table, plan_table
from truepose.identification.leaves.planning.words import plan_lines, plan_notes
from truepose.identification.report.notes import worded
from truepose.models.units import convert
from truepose.shown.chart import Chart, strips
from truepose.shown.document import Document, Items, Table
from truepose.shown.result import document, frame

_JOINTS_MOST = 12
_UNITS = "in the units of the machine file"


@document.register
def _(found: Plan) -> Document:
    return Document(
        "Plan",
        f"Plan of {len(found.q)} poses to calibrate {found.machine.name}: {found.method}, seed {found.seed}",
        summary=[Items(plan_lines(found)), Table.of(frame(found))],
        notes=plan_notes(found),
        more=f"to_frame() has all poses, {_UNITS}",
        charts=partial(_poses, found),
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


@frame.register
def _(found: Plan) -> pd.DataFrame:
    return plan_table(found)


@frame.register
def _(found: Experiment) -> pd.DataFrame:
    return experiment_table(found)


def _poses(found: Plan) -> list[Chart]:
    """Where the poses lie in the joints' ranges."""
    values, ends = {}, {}
    for k, actuator in enumerate(found.machine.mechanism.actuators[:_JOINTS_MOST]):
        unit = found.machine.column_unit(actuator.reading)
        low, high = actuator.range or (float(found.q[:, k].min()), float(found.q[:, k].max()))
        low, high = (convert(end, actuator.reading_unit, unit) for end in (low, high))
        ends[actuator.reading] = low, high, unit
        values[actuator.reading] = convert(found.q[:, k], actuator.reading_unit, unit).tolist()
    return strips(values, ends, "poses in the joints' ranges")
