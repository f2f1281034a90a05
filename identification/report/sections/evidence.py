"""Section 3: the map of evidence over places, and the best explanations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.result import Alternative, Diagnosis
from truepose.identification.report.document import Block, Plot, Section, Table, Text
from truepose.identification.report.figures import evidence
from truepose.identification.report.numbers import percent, significant

Array = NDArray[np.float64]
CANDIDATES = 15


def evidence_section(diagnosis: Diagnosis) -> Section:
    """Map over places and the best candidates."""
    blocks: list[Block] = []
    places = {p for f in diagnosis.findings for p in f.place}
    if diagnosis.evidence_map:
        hidden = max(len(diagnosis.evidence_map) - evidence.SHOWN, 0)
        caption = (
            "Evidence of the best single explanation at each place, weighed alone against a model that leaves"
            " nothing out. Bars beyond 3 are worth a name; a strong cause lends some evidence to places that"
            " partly imitate it." + (f" The {hidden} weakest places are not shown." if hidden else "")
        )
        blocks.append(Plot(evidence.evidence_map(diagnosis.evidence_map, places), caption))
    else:
        blocks.append(Text("No explanation could be weighed."))
    if diagnosis.candidates:
        blocks.append(_best(diagnosis))
    return Section("places", "Map of evidence", blocks)


def _best(diagnosis: Diagnosis) -> Table:
    merged = _merged(diagnosis.candidates)
    rows = [
        [
            str(k),
            c.effect,
            ", ".join(c.place),
            str(n),
            significant(c.log_bayes_factor),
            percent(c.probability),
        ]
        for k, (c, n) in enumerate(merged[:CANDIDATES], 1)
    ]
    caption = (
        f"The best {len(rows)} of {len(merged)} explanations (an effect at a place), each weighed alone,"
        " before any effect was accepted. Forms: orders, lags or shapes of the effect that were tried; the"
        " best one's evidence and the sum of their probabilities are shown."
    )
    head = ["", "effect", "place", "forms", "log Bayes factor", "probability"]
    return Table(head, rows, caption, text_columns=3)


def _merged(candidates: Sequence[Alternative]) -> list[tuple[Alternative, int]]:
    """One line an effect and place: its best form with the summed probability, how many forms; best first."""
    groups: dict[tuple[str, tuple[str, ...]], list[Alternative]] = {}
    for c in candidates:
        if np.isfinite(c.log_bayes_factor):
            groups.setdefault((c.effect, c.place), []).append(c)
    out = []
    for forms in groups.values():
        best = max(forms, key=lambda c: c.log_bayes_factor)
        out.append((replace(best, probability=sum(c.probability for c in forms)), len(forms)))
    return sorted(out, key=lambda item: -item[0].log_bayes_factor)
