"""The part of a report on constants: digits, what is folded, what is drawn of many, and how estimates go together."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from support.reports import fitted, gear, of, recorded, rows, summary, synthetic
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimate import Estimate
from truepose.identification.report.constants import constants_blocks, departure_block, parameter_section
from truepose.identification.report.naming import plain_names
from truepose.models.machine.machine import Machine
from truepose.shown.chart import Chart, Level, Marks
from truepose.shown.document import Charts, Fold, Table

INF = float("inf")


def with_std(machine: Machine, std: float, value: float) -> list[str]:
    """How the constant q2.d is told that has this value and 1-sigma."""
    fit = fitted(machine, recorded(machine), away=0.0)
    free = list(fit.prior.free)
    k = free.index(fit.prior.names.index("q2.d"))
    # a prior that says nothing of it beside readings that say all: the 1-sigma is that of the readings
    factor = np.triu(np.eye(len(free) + 1)) * 1e3
    factor[k, k] = fit.prior.scale[free[k]] / std
    p = fit.p.copy()
    p[free[k]] = value
    own = replace(fit, factor=factor, p=p)
    (table,) = of(constants_blocks(own, "x.yaml"), Table)
    (row,) = [row for row in rows(table) if row[0] == "q2.d"]
    return row


@pytest.mark.parametrize(
    ("std", "value", "said"),
    [
        (0.0085, 150.123456, ("150.12346", "0.0092")), (0.0095, 150.123456, ("150.1235", "0.010")),
        (0.05, -150.123456, ("-150.1235", "0.048")), (0.05, 0.00004, ("0.0000", "0.048")),
        (0.05, -0.00004, ("0.0000", "0.048")),
    ],
)  # fmt: skip
def test_a_value_has_a_digit_beyond_those_that_are_known(
    machine: Machine, std: float, value: float, said: tuple[str, str]
) -> None:
    """Two of the 1-sigma's own, and one more; nothing is minus zero. The noise that is found makes a tenth more of it."""
    _, _, told, known, *_ = with_std(machine, std, value)
    assert (told, known) == said


def test_a_row_tells_drawing_tolerance_and_how_far_off(machine: Machine) -> None:
    fit = fitted(machine, recorded(machine))
    (table,) = of(constants_blocks(fit, "x.yaml"), Table)
    assert list(table.head) == [
        "constant",
        "drawing",
        "value",
        "1 sigma",
        "tolerance",
        "off, in tolerances",
        "unit",
    ]
    told = {row[0]: row for row in rows(table)}
    for k, p in enumerate(machine.parameters):
        if p.name in told:
            _, drawing, _, _, tolerance, off, unit = told[p.name]
            assert float(drawing) == pytest.approx(p.nominal, rel=6e-6, abs=1e-9)
            assert float(tolerance.replace("∞", "inf")) == pytest.approx(p.tolerance, rel=6e-3)
            assert unit == p.unit
            away = (fit.p[k] - p.nominal) / p.tolerance
            assert float(off) == pytest.approx(away, rel=6e-3)
            assert len(off.replace(".", "").lstrip("-0")) <= 3  # digits


@pytest.mark.parametrize("count", [6, 7])
def test_many_coefficients_of_effects_are_folded_few_stand_among_the_constants(
    machine: Machine, count: int
) -> None:
    """Two to an effect: twelve are few."""
    terms = tuple(replace(gear(machine), settings=(("order", float(k)),)) for k in range(1, count + 1))
    assert len({term.label for term in terms}) == count
    fit = fitted(machine, recorded(machine), terms)
    blocks = constants_blocks(fit, "x.yaml")
    (table,), folds = of(blocks, Table), of(blocks, Fold)
    names = list(plain_names(terms).values())
    assert len(names) == 2 * count
    assert names[0] == "transmission error of a geared joint at q1, order 1: a"
    if count == 6:
        assert not folds and [row[0] for row in rows(table)][-12:] == names
    else:
        assert folds[0].title == "14 coefficients of effects"
        assert [row[0] for row in rows(of(folds[0].blocks, Table)[0])] == names
        assert not {row[0] for row in rows(table)} & set(names)
    assert table.csv.count("\n") == len(fit.to_frame()) + 1  # all of them, and the head


# -- departures ----------------------------------------------------------------------------------------


def departures(count: int, *keys: str, allowed: float | None = None) -> tuple[Charts, list[str]]:
    """Of so many constants, the k-th of which stands k tolerances away in every fit, and further in a free one."""
    names = [f"c{k}" for k in range(count)]
    parameters = [SimpleNamespace(name=name, tolerance=1.0) for name in names]
    held = [SimpleNamespace(name="held", tolerance=0.0), SimpleNamespace(name="open", tolerance=INF)]
    away = np.arange(count + 2.0)
    fits = {
        key: cast(Estimate, SimpleNamespace(in_tolerances=away * (50.0 if key == "free" else 1.0)))
        for key in keys
    }
    machine = cast(Machine, SimpleNamespace(parameters=[*parameters, *held]))
    charts = departure_block(machine, fits, allowed)
    assert isinstance(charts, Charts)
    return charts, [str(name) for chart in charts.charts for name in chart.y.names]


def test_the_sixty_farthest_constants_are_drawn_the_farthest_first() -> None:
    for count, more in ((60, ""), (61, " The 60 farthest of 61 are shown.")):
        charts, names = departures(count, "calibrated")
        assert names == [f"c{k}" for k in range(count - 1, count - 61, -1)]
        assert charts.caption.endswith(f"Marks at the edge lie beyond the scale.{more}")
        assert [len(chart.y.names) for chart in charts.charts] == [20, 20, 20]


def test_a_free_fit_beside_others_runs_off_the_scale() -> None:
    def reach(*keys: str) -> float:
        high = departures(10, *keys)[0].charts[0].x.high
        assert high is not None
        return high

    assert reach("free", "before") == reach("before") == pytest.approx(1.12 * 9.0)
    assert reach("free") == pytest.approx(1.12 * 450.0)


@pytest.mark.parametrize(("terms", "allowed"), [(True, 5.0), (False, 7.0)])
def test_the_limit_that_is_drawn_is_that_of_the_last_fit(
    machine: Machine, terms: bool, allowed: float
) -> None:
    found = synthetic(machine)
    fits = {
        "before": replace(summary(9.0, 12.0), worst_allowed=7.0),
        "after": replace(summary(1.0, 1.2), worst_allowed=5.0),
    }
    own = replace(found, fits=fits, terms=found.terms if terms else ())
    chart, names = _limits(own)
    assert names == (
        ["free fit", "tolerances, no effects", "with effects"]
        if terms
        else ["free fit", "tolerances, no effects"]
    )
    levels = [layer.value for layer in chart.layers if isinstance(layer, Level) and layer.name]
    assert levels == [-allowed, allowed]
    bare = replace(own, fits={})
    assert not [layer for layer in _limits(bare)[0].layers if isinstance(layer, Level) and layer.name]


def _limits(found: Diagnosis) -> tuple[Chart, list[str]]:
    section = parameter_section(found)
    assert (section.anchor, section.title) == ("constants", "Calibrated constants")
    averaged = "They are averages" in of(section.blocks, Table)[0].caption
    assert averaged is bool(found.terms)
    chart = of(section.blocks, Charts)[0].charts[0]
    return chart, [layer.name for layer in chart.layers if isinstance(layer, Marks)]


# -- correlations --------------------------------------------------------------------------------------
