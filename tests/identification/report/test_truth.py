"""What a demonstration's known truth is set beside: names that were found, errors of constants, matrices, displacements."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from support.results import machine as bundled
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.report.closing import truth_section
from truepose.models.effects.base import PlacedEffect, effects
from truepose.shown.chart import Cells, Chart, Line, Marks
from truepose.shown.document import Block, Charts, Table, Text

Array = NDArray[np.float64]
BENDS = ("platform-deformation", ("platform",))
PLAY = ("backlash", ("q1",))


def told(*found: tuple[str, tuple[str, ...]], **more: Any) -> Diagnosis:
    findings = [SimpleNamespace(effect=slug, place=place) for slug, place in found]
    return cast(
        Diagnosis, SimpleNamespace(**{"findings": findings, "nominal": bundled(), "terms": (), **more})
    )


def blocks(diagnosis: Diagnosis, truth: dict[str, object]) -> list[Block]:
    section = truth_section(diagnosis, truth)
    assert section.title == "Truth against what was found"
    return list(section.blocks)


def stated(*real: tuple[str, tuple[str, ...]]) -> dict[str, object]:
    return {"effects": [{"effect": slug, "place": list(place)} for slug, place in real]}


LEAD = "This recording was simulated, so the truth is known (the diagnosis never saw it)."


@pytest.mark.parametrize(
    ("real", "found", "tone", "said"),
    [
        ((), (), "good", "No physics was left out of the machine file; none was named."),
        ((), (PLAY, BENDS), "warn", "No physics was left out of the machine file; named all the same:"
         " backlash at q1 and platform-deformation at platform."),
        ((PLAY,), (PLAY,), "good", "Left out of the machine file: backlash at q1; all of it was found;"
         " nothing else was named."),
        ((PLAY,), (PLAY, BENDS), "warn", "Left out of the machine file: backlash at q1; all of it was found;"
         " found beyond it: platform-deformation at platform."),
        ((PLAY, BENDS), (PLAY,), "warn", "Left out of the machine file: backlash at q1 and platform that bends"
         " (platform-deformation) at platform; not found under that name: platform-deformation; nothing else was named."),
        ((PLAY,), (("backlash", ("q2",)),), "warn", "Left out of the machine file: backlash at q1; not found under that"
         " name: backlash; found beyond it: backlash at q2."),
    ],
)  # fmt: skip
def test_the_verdict_says_what_was_missed_and_what_was_named_beyond_it(
    real: tuple[tuple[str, tuple[str, ...]], ...],
    found: tuple[tuple[str, tuple[str, ...]], ...],
    tone: str,
    said: str,
) -> None:
    (text,) = blocks(told(*found), stated(*real))
    assert isinstance(text, Text) and (text.text, text.tone) == (f"{LEAD} {said}", tone)


def test_one_effect_or_several_may_be_stated() -> None:
    one = {"effect": "backlash", "place": ["q1"]}
    assert true_effects({"effect": one}) == true_effects({"effects": [one]}) == [PLAY]
    assert true_effects({"effect": {"effect": "latency"}}) == [("latency", ())]
    assert true_effects({"effects": [one, "no mapping"]}) == [PLAY]
    assert true_effects({"effects": [], "effect": one}) == [PLAY] and true_effects({}) == []


# -- constants -----------------------------------------------------------------------------------------


def fits(terms: bool, sure: int) -> tuple[Diagnosis, dict[str, object], Array]:
    """Of the telescope: each fit is off by so many tolerances everywhere; the first ``sure`` constants are well known."""
    machine = bundled()
    size = len(machine.parameters)
    rng = np.random.default_rng(4)
    true = rng.normal(size=size)
    values = {
        p.name: {"value": p.nominal + true[k] * p.tolerance}
        for k, p in enumerate(machine.parameters)
        if 0 < p.tolerance < np.inf
    }
    judged = np.array([p.name in values for p in machine.parameters])
    tolerance = np.array([p.tolerance for p in machine.parameters])
    rank = np.cumsum(judged) - 1

    def fit(off: float, known: int) -> SimpleNamespace:
        std = np.where(rank < known, 0.49, 0.51) * tolerance
        return SimpleNamespace(in_tolerances=true + off, std=std)

    last = fit(0.25, sure if terms else 0)
    own = told(
        terms=("one",) if terms else (),
        free=fit(8.0, 99),
        before=fit(-2.0, 99 if terms else sure),
        after=last,
    )
    return own, {"parameters": values}, true[judged]


@pytest.mark.parametrize("terms", [True, False])
def test_errors_of_constants_stand_by_the_fit_and_by_how_well_they_are_known(terms: bool) -> None:
    """Root of the mean square, in tolerances; well known is what the last fit knows to half a tolerance."""
    diagnosis, truth, true = fits(terms, 10)
    _, table, charts = blocks(diagnosis, truth)
    assert isinstance(table, Table) and isinstance(charts, Charts)
    names = ["", "drawing", "free fit", "tolerances, no effects", "with effects"]
    assert list(table.head) == (names if terms else names[:-1])
    few, every = table.rows
    assert few[0] == "rms error of parameters, well determined (10)"
    assert every[0] == f"rms error of parameters, all ({len(true)})"
    errors = ["8.00", "2.00", "0.250"] if terms else ["8.00", "2.00"]
    assert list(few[2:]) == list(every[2:]) == errors
    for row, part in ((few, true[:10]), (every, true)):
        assert float(row[1]) == pytest.approx(float(np.sqrt(np.mean(part**2))), rel=6e-3)  # three digits
    assert charts.caption.startswith(
        "The 10 parameters that the readings determine to better than half a tolerance:"
    )
    (chart,) = charts.charts
    line, *marks = chart.layers
    assert isinstance(line, Line) and line.dashed
    np.testing.assert_array_equal(line.x, line.y)
    offs = [-2.0, 0.25] if terms else [-2.0]
    assert [one.name for one in marks if isinstance(one, Marks)] == names[3 : 3 + len(offs)]
    assert [one.shape for one in marks if isinstance(one, Marks)] == ["ring", "dot"][: len(offs)]
    for one, off in zip(marks, offs, strict=True):
        assert isinstance(one, Marks)
        np.testing.assert_allclose(one.y - one.x, off)
        np.testing.assert_allclose(one.x, true[:10], atol=1e-9)  # nominal + true, less nominal
    _within(chart, marks)


def _within(chart: Chart, marks: list[Any]) -> None:
    """Both axes are even about zero, and reach a tenth beyond the farthest that they show, or beyond one."""
    for axis, values in (
        (chart.x, [one.x for one in marks]),
        (chart.y, [v for one in marks for v in (one.x, one.y)]),
    ):
        assert axis.low is not None and axis.high == -axis.low
        assert axis.high == pytest.approx(1.1 * max(1.0, *(np.max(np.abs(v)) for v in values)))


def test_nothing_known_well_is_not_drawn_and_constants_without_a_truth_are_left_out() -> None:
    diagnosis, truth, _ = fits(True, 0)
    _, table = blocks(diagnosis, truth)
    assert (
        isinstance(table, Table)
        and len(table.rows) == 1
        and table.rows[0][0].startswith("rms error of parameters, all (")
    )
    for nothing in ({}, None, {"no such name": {"value": 1.0}}):
        assert len(blocks(diagnosis, {"parameters": nothing})) == 1
    name = next(iter(cast("dict[str, object]", truth["parameters"])))
    one = {name: cast("dict[str, object]", truth["parameters"])[name]}
    _, table = blocks(diagnosis, {"parameters": one})
    assert isinstance(table, Table) and table.rows[0][0] == "rms error of parameters, all (1)"


# -- matrices ------------------------------------------------------------------------------------------


def entries() -> list[str]:
    effect = effects.get("platform-deformation", "test")()
    term = PlacedEffect.at(effect, bundled(), ("platform",), {"form": 1.0}, {})
    return [c.name for c in term.coefficients]


def test_the_true_matrix_stands_beside_the_estimate_and_their_difference() -> None:
    """In thousandths; the largest displacement as identified over the rows that were measured, beside the truth's."""
    kappa = np.array([1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3])
    machine, names = bundled(), entries()
    assert len(names) == 6
    effect = effects.get("platform-deformation", "test")()
    values = dict(zip(names, kappa.tolist(), strict=True))
    term = PlacedEffect.at(effect, machine, ("platform",), {"form": 1.0}, values)
    q = np.zeros((3, 6))
    q[1, 2], q[2, 4] = 3.0, -7.0
    found = told(BENDS, terms=(term,), recording=SimpleNamespace(q=q))
    true = np.diag(kappa) + 1e-4
    size = {"unit": "um", "norm": 60.0, "xyz": [5.0, 4.0, 59.0]}
    _, table, charts = blocks(found, {"K": {"value": true.tolist()}, "leg_end_displacement_max": size})
    assert isinstance(table, Table) and isinstance(charts, Charts)
    assert list(table.head) == ["", "truth", "as identified (along z)"]
    assert [list(row) for row in table.rows] == [
        ["largest displacement of a leg's end", "60.0 µm", ""],
        ["its largest along x", "5.00 µm", ""],
        ["its largest along y", "4.00 µm", ""],
        ["its largest along z", "59.0 µm", "35.0 µm"],
    ]
    shown = []
    for chart in charts.charts:
        (cells,) = chart.layers
        assert isinstance(cells, Cells)
        shown.append(cells.values)
    titles = ["truth", "estimate", "estimate less truth"]
    assert [chart.title for chart in charts.charts] == titles
    for values_, expected in zip(shown, (true, np.diag(kappa), np.full((6, 6), -1e-4)), strict=True):
        np.testing.assert_allclose(values_, 1e3 * expected, atol=1e-12)
    # without a true matrix of its shape there is nothing to set it beside
    for other in ({}, {"K": {"value": [[1.0]]}}, {"K": "no mapping"}):
        (_, alone) = blocks(
            found, {**other, "leg_end_displacement_max": {"unit": "mm", "norm": 0.06, "xyz": [1.0]}}
        )
        assert isinstance(alone, Table) and list(alone.head) == ["", "truth"]
        assert [list(row) for row in alone.rows] == [["largest displacement of a leg's end", "60.0 µm"]]
