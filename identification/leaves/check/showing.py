"""A check as it is shown in a session and in a notebook.

What a check found, in words: for the terminal, and as the first line of a result.
"""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from truepose.identification.leaves.check.result import Check, Found
from truepose.identification.report.verdict import missing_words
from truepose.shown.document import Document, Items, Table
from truepose.shown.result import document, frame
from truepose.shown.text import wrapped

# -- What a check found, in words: for the terminal, and as the first line of a result

VERDICTS = {
    "ok": "ok: the recording fits the machine file",
    "suspect": "suspect: the recording may not belong to the machine file as it stands",
    "wrong": "wrong: the recording does not belong to the machine file as it stands",
}


def check_lines(check: Check, written: Sequence[str] = ()) -> list[str]:
    """Lines of ``truepose check``."""
    lines = [VERDICTS[check.verdict]]
    for found in check.found:
        lines.append(f"  {found.kind}: {found_words(found)}")
        lines.append(f"    to mend: {found.fix}")
        if found.instead:
            lines.append(f"    fits as well: {'; '.join(found.instead[:3])}")
    if check.left is not None:
        mended = "mended and " if check.left_mended else ""
        lines.append(
            f"{mended}within its tolerances, the machine is off by {check.left:.3g} {check.unit} rms over "
            f"{check.left_rows} of {check.rows} rows"
        )
    for text in missing_words(check.missing):
        lines += wrapped(f"cannot be tested: {text}")
    if written:
        lines.append(f"written: {', '.join(written)}")
    return lines


def found_words(found: Found) -> str:
    """One finding in a line: what it says and by how much it fits better."""
    if found.after is None or found.kind == "sigma":
        return found.says
    if found.before is None:
        return f"{found.says}: it would fit to {found.after:.3g} {found.unit} rms; as it stands nothing fits"
    times = found.before / found.after if found.after > 0 else float("inf")
    if times < 1.5:  # readings alone do not tell: it is the frames that the file states
        return found.says
    after, before = (f"{size:.3g} {found.unit}" for size in (found.after, found.before))
    return f"{found.says}: it would fit {times:,.3g} times better, rms {after} ({before} as it stands)"


def refusal(check: Check) -> str:
    """One line for a command that refuses to go on."""
    wrong = [f for f in check.found if f.verdict == "wrong"]
    first = wrong[0]
    more = f" (and {len(wrong) - 1} more)" if len(wrong) > 1 else ""
    return (
        f"{first.kind}: {found_words(first)}; {first.fix}{more}; 'truepose check' says more, --anyway goes on"
    )


def caution(check: Check) -> list[str]:
    """What stands above a result where something may be wrong, or was passed over."""
    return [f"{f.verdict.upper()}: {f.kind}: {found_words(f)}; {f.fix}" for f in check.found]


def checked(check: Check) -> dict[str, object]:
    """What a result's JSON holds of a check: nothing where all is well."""
    return {"check": check.document()} if check.found else {}


# -- A check as it is shown in a session and in a notebook


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
