"""How well the tool is known: the uncertainty budget, and tests after the standards."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from truepose.arrays import Array
from truepose.errors import TrueposeError
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.repeatability import PoseTest, axis_tests, pose_test
from truepose.identification.fit.tool_pose import (
    EXPLANATIONS,
    READINGS,
    TOLERANCES,
    UNEXPLAINED,
    ToolSpread,
    tool_spread,
)
from truepose.identification.recording.recording import Recording
from truepose.identification.report.numbers import measure
from truepose.identification.report.scene import thinned
from truepose.shown.document import Block, Section, Table, Text

ROWS = 300
COVERAGE = 2.0
"""Coverage factor: an interval of about 95 %."""
_SOURCES: Mapping[str, tuple[str, str]] = {
    READINGS: ("noise of the readings, as it went through the fit", "A"),
    TOLERANCES: ("what the readings leave to the drawing's tolerances", "B"),
    EXPLANATIONS: ("explanations that the readings cannot tell apart", "B"),
    UNEXPLAINED: ("what the model leaves unexplained beyond the instrument's noise", "A"),
}


def uncertainty_section(fit: Estimate, recording: Recording, before: Estimate | None) -> Section:
    """Return the budget at the recorded poses, and ISO 9283 and ISO 230-2 where the recording allows it.

    ``before``: the fit to compare the standards' figures with, None for a calibration alone.
    """
    good = np.flatnonzero(np.isfinite(fit.residual).all(axis=1))
    if not len(good) or not len(fit.prior.free):
        said = "Nothing was estimated, so there is no uncertainty to tell."
        return Section("uncertainty", "How well the tool's position is known", [Text(said)])
    try:
        blocks: list[Block] = [_budget(tool_spread(fit, recording, thinned(good, ROWS)))]
    except TrueposeError as exc:
        blocks = [Text(f"The uncertainty of the tool could not be evaluated: {exc}")]
    blocks += _standards(fit, recording, before)
    return Section("uncertainty", "How well the tool's position is known", blocks)


def _budget(spread: ToolSpread) -> Table:
    """Sources, their standard uncertainties and shares, combined and expanded."""
    mean = {source: float(np.mean(v)) for source, v in spread.variance.items()}
    whole = sum(mean.values())
    rows = [
        [*_SOURCES[source], measure(float(np.sqrt(v)), "mm"), f"{100 * v / whole:.0f} %" if whole else "-"]
        for source, v in mean.items()
    ]
    combined = float(np.sqrt(whole))
    rows.append(["combined standard uncertainty", "", measure(combined, "mm"), "100 %"])
    rows.append([f"expanded uncertainty, k = {COVERAGE:g}", "", measure(COVERAGE * combined, "mm"), ""])
    caption = (
        "Uncertainty of the tool's position in the sensor's frame, root of the mean over the recorded poses, after the GUM"
        " (JCGM 100:2008). Type A comes from the scatter of readings, type B from other knowledge. It is that of the model:"
        " a single reading has the instrument's noise beside it, and an error that the instrument makes in all readings is"
        " not in it."
    )
    head = ["source", "type", "standard uncertainty", "share of variance"]
    return Table(head, rows, caption, text_columns=2)


def _standards(fit: Estimate, recording: Recording, before: Estimate | None) -> list[Block]:
    out: list[Block] = []
    now = pose_test(fit, recording)
    if now is not None:
        was = None if before is None else pose_test(before, recording)
        out.append(_iso_9283(now, was))
    axes = axis_tests(fit, recording)
    if axes:
        rows = [
            [
                a.joint,
                *(measure(v, "mm") for v in (a.accuracy, a.systematic, a.repeatability, a.reversal)),
                f"{a.targets}, {a.runs}",
            ]
            for a in axes
        ]
        head = ["axis", "accuracy A", "systematic E", "repeatability R", "reversal B", "targets, runs a side"]
        caption = (
            "Positioning after ISO 230-2, bidirectional, of what was read against the calibrated model. The standard asks for"
            " five targets a metre and five runs from each side."
        )
        out.append(Table(head, rows, caption))
    if not out:
        needs = (
            "ISO 9283 (pose accuracy and repeatability) needs poses that are visited three times and more under one number"
            " in the column `pose`; ISO 230-2 (an axis) needs a slide that moves alone to five targets and more, twice from"
            " each side, with its `approach` column. This recording has neither."
        )
        out.append(Text(needs, "muted"))
    return out


def _iso_9283(now: PoseTest, was: PoseTest | None) -> Table:
    """AP and RP, mean and worst pose, before and after."""

    def both(values: Array) -> list[str]:
        return [measure(float(np.mean(values)), "mm"), measure(float(np.max(values)), "mm")]

    rows = [] if was is None else [["pose accuracy AP, before", *both(was.accuracy)]]
    rows.append(["pose accuracy AP, with this model", *both(now.accuracy)])
    rows.append(["pose repeatability RP", *both(now.repeatability)])
    visits = f"{int(now.visits.min())} to {int(now.visits.max())}"
    caption = (
        f"After ISO 9283, of {len(now.visits)} poses with {visits} visits each; the standard asks for 30 visits of five poses."
        " AP: from the model's position to the mean of the readings. RP: mean distance from that mean plus three standard"
        " deviations; no calibration improves it."
    )
    return Table(["", "mean pose", "worst pose"], rows, caption)
