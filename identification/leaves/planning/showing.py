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
from truepose.shown.drawing import strips
from truepose.shown.result import frame, view
from truepose.shown.view import View

_JOINTS_MOST = 12


@view.register
def _(found: Plan) -> View:
    table = frame(found)
    return View(
        f"Plan of {len(found.q)} poses to calibrate {found.machine.name}: {found.method}, seed {found.seed}",
        facts=(*plan_lines(found), *(f"note: {text}" for text in plan_notes(found))),
        head=tuple(map(str, table.columns)),
        rows=tuple(tuple(f"{value:g}" for value in row) for row in table.itertuples(index=False)),
        more="to_frame() has all poses, in the units of the machine file",
        picture=partial(draw_poses, found),
    )


@frame.register
def _(found: Plan) -> pd.DataFrame:
    return plan_table(found)


def draw_poses(found: Plan) -> str:
    """Where the poses lie in the joints' ranges."""
    values, ends = {}, {}
    for k, actuator in enumerate(found.machine.mechanism.actuators[:_JOINTS_MOST]):
        unit = found.machine.column_unit(actuator.reading)
        column = convert(found.q[:, k], actuator.reading_unit, unit)
        low, high = actuator.range or (float(found.q[:, k].min()), float(found.q[:, k].max()))
        ends[actuator.reading] = tuple(convert(end, actuator.reading_unit, unit) for end in (low, high))
        values[actuator.reading] = column.tolist()
    return strips(
        values, {name: (a, b) for name, (a, b) in ends.items()}, title="poses in the joints' ranges"
    )


@view.register
def _(found: Experiment) -> View:
    table = frame(found)
    return View(
        f"Experiment of {len(table)} rows on {found.machine.name}, seed {found.seed}",
        facts=(*sentences(found), *(f"note: {text}" for text in worded(found.notes))),
        head=tuple(map(str, table.columns)),
        rows=tuple(tuple(f"{value:g}" for value in row) for row in table.itertuples(index=False)),
        more="to_frame() has all rows, in the units of the machine file",
    )


@frame.register
def _(found: Experiment) -> pd.DataFrame:
    return experiment_table(found)
