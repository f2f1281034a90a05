"""A check as it is shown in a session and in a notebook."""

from __future__ import annotations

import pandas as pd

from truepose.identification.leaves.check.result import Check
from truepose.identification.leaves.check.words import VERDICTS, check_lines
from truepose.shown.document import Document, Items, Table
from truepose.shown.result import document, frame


@document.register
def _document(check: Check) -> Document:
    """What there is to see of a check: the lines of the command, and its findings as a table."""
    rows = [(f.kind, ", ".join(f.where), f.verdict, f.says) for f in check.found]
    facts = [line.strip() for line in check_lines(check)[1:]]
    table = Table(["kind", "where", "verdict", "what"], rows)
    return Document("Check", f"Check: {VERDICTS[check.verdict]}", summary=[Items(facts), table])


@frame.register
def _frame(check: Check) -> pd.DataFrame:
    """The findings of a check, as ``Check.to_frame`` says."""
    columns = ("kind", "where", "verdict", "before", "after", "unit", "says", "fix")
    told = [{**f.document(), "where": ", ".join(f.where)} for f in check.found]
    return pd.DataFrame([[one[name] for name in columns] for one in told], columns=list(columns))
