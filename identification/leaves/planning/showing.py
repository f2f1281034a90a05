"""Plans and experiments as they show themselves, and as tables."""

from __future__ import annotations

import pandas as pd

from truepose.identification.leaves.planning.discriminate.experiment import Experiment
from truepose.identification.leaves.planning.discriminate.words import sentences
from truepose.identification.leaves.planning.plan import Plan
from truepose.identification.leaves.planning.pose_tables import experiment_table, plan_table
from truepose.identification.leaves.planning.words import plan_lines, plan_notes
from truepose.identification.report.notes import worded
from truepose.shown.document import Document, Items, Table
from truepose.shown.result import document, frame

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


@frame.register
def _(found: Plan) -> pd.DataFrame:
    return plan_table(found)


@frame.register
def _(found: Experiment) -> pd.DataFrame:
    return experiment_table(found)
