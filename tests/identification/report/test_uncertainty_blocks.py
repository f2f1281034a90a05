"""The budget, the map and the standards' figures of a report, number by number, of a spread that is made up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from support.reports import arm, fitted, of, recorded, rows
from truepose.errors import InputError
from truepose.identification.fit.axis_positioning import AxisTest
from truepose.identification.fit.estimate import Estimate
from truepose.identification.fit.tool_spread import (
    EXPLANATIONS,
    READINGS,
    TOLERANCES,
    UNEXPLAINED,
    ToolSpread,
)
from truepose.identification.recording.recording import Recording
from truepose.identification.report import uncertainty
from truepose.identification.report.uncertainty import uncertainty_section
from truepose.shown.chart import Marks
from truepose.shown.document import Block, Charts, Table, Text

Array = NDArray[np.float64]
PLACES = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 50.0], [6.0, 7.0, 8.0], [9.0, 10.0, 11.0]])


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return recorded(arm(tmp_path_factory.mktemp("machine")))


@pytest.fixture(scope="module")
def fit(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Estimate:
    return fitted(arm(tmp_path_factory.mktemp("machine")), recording)


@pytest.fixture
def told(fit: Estimate, recording: Recording, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The blocks for a budget with these variances, and a workspace with these standard uncertainties at four places."""

    def made(variance: Mapping[str, Sequence[float]], std: Sequence[float], size: float = 1.0) -> list[Block]:
        sources = {name: np.array(v, dtype=float) for name, v in variance.items()}
        there = ToolSpread(size * PLACES[: len(std)], {READINGS: np.array(std, dtype=float) ** 2})
        inside = np.arange(len(std)) != 1
        monkeypatch.setattr(uncertainty, "tool_spread", lambda *_: ToolSpread(PLACES, sources))
        monkeypatch.setattr(uncertainty, "workspace", lambda *_: (there, inside))
        return list(uncertainty_section(fit, recording, None).blocks)

    return made


def test_a_budget_is_the_root_of_mean_variances_with_their_shares(told: Any) -> None:
    """Sources of both types; twice the combined one is the expanded uncertainty."""
    variance = {
        READINGS: [0.0, 8e-4], TOLERANCES: [3e-4, 3e-4], EXPLANATIONS: [2e-4, 0.0], UNEXPLAINED: [0.0, 0.0]
    }  # fmt: skip
    table = of(told(variance, [1.0]), Table)[0]
    assert [row[1:] for row in rows(table)] == [
        ["A", "20.0 µm", "50 %"],
        ["B", "17.3 µm", "38 %"],
        ["B", "10.0 µm", "12 %"],
        ["A", "0 mm", "0 %"],
        ["", "28.3 µm", "100 %"],
        ["", "56.6 µm", ""],
    ]
    assert table.text_columns == 2
    nothing = of(told({READINGS: [0.0, 0.0]}, [1.0]), Table)[0]
    assert rows(nothing)[0][2:] == ["0 mm", "-"] and rows(nothing)[1][2:] == ["0 mm", "100 %"]


def test_places_of_the_workspace_are_drawn_by_quarters_of_their_uncertainty(told: Any) -> None:
    """Each in one level, the least known in the last; coordinates in a unit of their size."""
    (charts,) = of(told({READINGS: [1.0]}, [0.01, 0.02, 0.03, 0.04]), Charts)
    above, side = charts.charts
    assert (above.x.title, above.y.title, side.y.title) == ("x [mm]", "y [mm]", "z [mm]")
    drawn = [
        (layer.tone, layer.name, layer.shape, layer.x.tolist(), layer.y.tolist())
        for layer in side.layers
        if isinstance(layer, Marks)
    ]
    assert drawn == [
        ("l1", "10 to 17.5 µm", "dot", [0.0], [2.0]),
        ("l2", "17.5 to 25 µm, beyond what was measured", "ring", [3.0], [50.0]),
        ("l3", "25 to 32.5 µm", "dot", [6.0], [8.0]),
        ("l4", "32.5 to 40 µm", "dot", [9.0], [11.0]),
    ]
    (small,) = of(told({READINGS: [1.0]}, [0.01, 0.02, 0.03, 0.04], size=0.01), Charts)
    assert small.charts[0].x.title == "x [µm]"
    first = next(layer for layer in small.charts[0].layers if isinstance(layer, Marks))
    assert first.y.tolist() == pytest.approx([10.0])


@pytest.mark.parametrize("std", [[], [0.0, 0.0], [1.0, np.nan], [np.inf, 1.0]])
def test_a_workspace_of_which_nothing_is_known_is_not_drawn(told: Any, std: list[float]) -> None:
    blocks = told({READINGS: [1.0]}, std)
    assert not of(blocks, Charts) and of(blocks, Table)
    assert of(told({READINGS: [1.0]}, [0.0, 1.0]), Charts)


def test_what_cannot_be_evaluated_is_said(
    fit: Estimate, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The standards' figures stand all the same, or that there are none."""

    def fails(*_: object) -> None:
        raise InputError("no pose can be assembled")

    monkeypatch.setattr(uncertainty, "tool_spread", fails)
    first, second = uncertainty_section(fit, recording, None).blocks
    assert isinstance(first, Text) and isinstance(second, Text)
    assert first.text == "The uncertainty of the tool could not be evaluated: no pose can be assembled"
    assert second.text.startswith("ISO 9283 (pose accuracy") and second.tone == "muted"


def test_nothing_free_nothing_known(fit: Estimate, recording: Recording) -> None:
    held = replace(fit, prior=SimpleNamespace(free=np.zeros(0, dtype=int)))  # type: ignore[arg-type]
    (text,) = uncertainty_section(held, recording, None).blocks
    assert isinstance(text, Text) and text.text.startswith("Nothing was estimated")


def test_an_axis_that_moved_alone_is_a_row(told: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    slide = AxisTest("m1", 0.004, 0.003, 0.002, 0.001, 7, 5)
    monkeypatch.setattr(uncertainty, "axis_tests", lambda *_: [slide])
    blocks = told({READINGS: [1.0]}, [1.0])
    table = of(blocks, Table)[-1]
    assert rows(table) == [["m1", "4.00 µm", "3.00 µm", "2.00 µm", "1.00 µm", "7, 5"]]
    assert not [text for text in of(blocks, Text) if text.text.startswith("ISO 9283")]
    assert [title for title in table.head if title] == [
        "axis", "accuracy A", "systematic E", "repeatability R", "reversal B", "targets, runs a side"
    ]  # fmt: skip
