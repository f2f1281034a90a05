"""How well the tool is known: the uncertainty budget, a map of the workspace, and tests after the standards."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from truepose.arrays import Array, Mask
from truepose.errors import TrueposeError
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.repeatability import PoseTest, pose_test
from truepose.identification.fit.tool_pose import (
    EXPLANATIONS,
    READINGS,
    TOLERANCES,
    UNEXPLAINED,
    ToolSpread,
    tool_spread,
    workspace,
)
from truepose.identification.recording.recording import Recording
from truepose.identification.report.numbers import finer, measure, unit_symbol
from truepose.identification.report.scene.scene import thinned
from truepose.shown.chart import Axis, Chart, Layer, Marks, Tone
from truepose.shown.document import Block, Charts, Section, Table, Text

ROWS = 300
COVERAGE = 2.0
"""Coverage factor: an interval of about 95 %."""
_SOURCES: Mapping[str, tuple[str, str]] = {
    READINGS: ("noise of the readings, as it went through the fit", "A"),
    TOLERANCES: ("what the readings leave to the drawing's tolerances", "B"),
    EXPLANATIONS: ("explanations that the readings cannot tell apart", "B"),
    UNEXPLAINED: ("what the model leaves unexplained beyond the instrument's noise", "A"),
}
_LEVELS: tuple[Tone, ...] = ("l1", "l2", "l3", "l4")


def uncertainty_section(fit: Estimate, recording: Recording, before: Estimate | None) -> Section:
    """Budget at the recorded poses, the workspace, and ISO 9283 where the recording allows it.

    ``before``: the fit to compare the standards' figures with, None for a calibration alone.
    """
    good = np.flatnonzero(np.isfinite(fit.residual).all(axis=1))
    if not len(good) or not len(fit.prior.free):
        said = "Nothing was estimated, so there is no uncertainty to tell."
        return Section("uncertainty", "How well the tool's position is known", [Text(said)])
    try:
        blocks: list[Block] = [_budget(tool_spread(fit, recording, thinned(good, ROWS)))]
        blocks += _map(*workspace(fit, recording))
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


def _map(spread: ToolSpread, inside: Mask) -> list[Block]:
    """The workspace from above and from the side, coloured by uncertainty."""
    std = spread.std
    if not np.isfinite(std).all() or not len(std) or not np.max(std) > 0:
        return []
    edges = np.quantile(std, [0.0, 0.25, 0.5, 0.75, 1.0])
    factor, unit = finer(float(edges[-1]), "mm")
    size, length = finer(float(np.max(np.ptp(spread.position, axis=0), initial=0.0)), "mm")
    charts = []
    for title, (a, b) in (("seen along z", (0, 1)), ("seen along y", (0, 2))):
        layers: list[Layer] = []
        for k, tone in enumerate(_LEVELS):
            level = (std >= edges[k]) & ((std < edges[k + 1]) | (k == 3))
            name = f"{factor * edges[k]:.3g} to {factor * edges[k + 1]:.3g} {unit_symbol(unit)}"
            for within, shape in ((True, "dot"), (False, "ring")):
                at = level & (inside == within)
                if at.any():
                    place = size * spread.position[at]
                    beyond = "" if within else ", beyond what was measured"
                    layers.append(Marks(place[:, a], place[:, b], tone, f"{name}{beyond}", shape))  # type: ignore[arg-type]
        x, y = (f"{'xyz'[k]} [{unit_symbol(length)}]" for k in (a, b))
        charts.append(Chart(title, Axis(x), Axis(y), layers, height=300.0))
    caption = (
        "Standard uncertainty of the tool's position over the workspace, as the model predicts it. Dots: within what the joints"
        " covered in the recording; rings: elsewhere in their ranges, where forms that were not seen may add to it."
    )
    return [Charts(charts, caption)]


def _standards(fit: Estimate, recording: Recording, before: Estimate | None) -> list[Block]:
    now = pose_test(fit, recording)
    if now is not None:
        return [_iso_9283(now, None if before is None else pose_test(before, recording))]
    return [
        Text(
            "ISO 9283 (pose accuracy and repeatability) needs poses that are visited three times and more under one number"
            " in the column `pose`. This recording has none.",
            "muted",
        )
    ]


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


__all__ = ["uncertainty_section"]
