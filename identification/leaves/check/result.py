"""What a check found: a verdict, and each slip with what it leaves of the misfit and how to mend it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from truepose.identification.leaves.check.pair import Mend, Pair
from truepose.identification.signatures.untestable import Missing
from truepose.shown.result import Shown

SCHEMA = "truepose/check/1"
Verdict = Literal["ok", "suspect", "wrong"]


@dataclass(frozen=True)
class Found:
    """One slip.

    before, after: rms misfit after base and tool alone were fitted, without and with the slip mended, in ``unit``; both None
    where it needs no fit to be seen, before also where the drawn machine cannot stand as its joints were read. instead: other
    slips that fit these readings as well.
    """

    kind: str
    where: tuple[str, ...]
    says: str
    fix: str
    verdict: Verdict
    before: float | None = None
    after: float | None = None
    unit: str = "mm"
    mend: Mend | None = field(default=None, repr=False)
    instead: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """As in ``check --json``."""
        names = ("kind", "where", "before", "after", "unit", "verdict", "says", "fix", "instead")
        told = {name: getattr(self, name) for name in names}
        return {**told, "where": list(self.where), "instead": list(self.instead)}


@dataclass(frozen=True, repr=False)
class Check(Shown):
    """Everything that a check found, worst first.

    left: rms misfit (``unit``) of ``left_rows`` rows, none left out but those that a hypothesis says were not logged, with
    all of it mended and constants within their tolerances.
    ``to_frame()``: one finding a row: ``kind``, ``where``, ``verdict``, ``before``, ``after``, ``unit``, ``says``, ``fix``.
    """

    found: tuple[Found, ...]
    rows: int
    left: float | None
    unit: str = "mm"
    missing: tuple[Missing, ...] = ()
    """What this machine likely has and the recording cannot show."""
    left_rows: int = 0
    left_mended: bool = False

    @property
    def verdict(self) -> Verdict:
        """``wrong`` where one of them is certain and spoils the fit, ``suspect`` where one may be, else ``ok``."""
        verdicts = {f.verdict for f in self.found}
        return "wrong" if "wrong" in verdicts else "suspect" if "suspect" in verdicts else "ok"

    def mended(self, pair: Pair) -> Pair:
        """The files with everything mended that can be."""
        for found in self.found:
            if found.mend is not None:
                pair = found.mend(pair)
        return pair

    def document(self) -> dict[str, Any]:
        """``truepose/check/1``."""
        return {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "found": [f.document() for f in self.found],
            "rows": self.rows,
            "misfit": None
            if self.left is None
            else {"value": self.left, "unit": self.unit, "rows": self.left_rows},
            "untestable": [{"effects": list(m.effects), "why": m.why, "add": m.add} for m in self.missing],
        }
