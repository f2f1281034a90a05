"""The part of a report on residuals: against which driver first, which else, of which rows, and of which fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from support.reports import gear_finding, of
from truepose.identification.diagnosis.alarm import Alarm
from truepose.identification.diagnosis.result import Diagnosis, Form, Remainder
from truepose.identification.report.residuals import diagnosis_fits, residual_section, telling_drivers
from truepose.models.machine.machine import Machine
from truepose.shown.chart import Marks
from truepose.shown.document import Block, Charts, Fold, Text

ROWS = np.arange(0, 30, 3)


def blocks(diagnosis: Diagnosis, rows: Any = ROWS) -> Sequence[Block]:
    section = residual_section(
        diagnosis.nominal, diagnosis.recording, diagnosis_fits(diagnosis), telling_drivers(diagnosis), rows
    )
    assert (section.anchor, section.title) == ("residuals", "Residuals")
    return section.blocks


def first(diagnosis: Diagnosis) -> str:
    """The driver that residuals are drawn against first."""
    caption = of(blocks(diagnosis), Charts)[0].caption
    start = "Signed residuals, in stated sigmas, against "
    assert caption.startswith(start)
    return caption[len(start) :].partition(",")[0]


def test_residuals_are_drawn_first_against_what_was_found_to_drive_them(plain: Diagnosis) -> None:
    """Of a finding its driver, then its place from the last on; then the remainder's driver, then what alarms are about."""
    quiet = Alarm(0.4, 0.5, "nothing", share=0.1)
    silent = replace(plain, findings=(), terms=(), alarms={}, alarms_after={"structure": quiet})
    assert first(silent) == "q1"  # the first column there is
    left = Remainder(("q2",), "temperature.base", Form("curve"), 2.1)
    air = "temperature.base"
    at_q2 = replace(gear_finding(), place=("q1", "q2"))
    for found, driver in (
        (replace(silent, alarms_after={"structure": replace(quiet, about="q2")}), "q2"),
        (replace(silent, alarms_after={"structure": replace(quiet, about="order")}), "order"),
        (replace(silent, alarms={"structure": replace(quiet, about=air)}), air),
        (replace(silent, alarms={"structure": quiet}, alarms_after={"structure": replace(quiet, about="q2")}), "q2"),
        (replace(silent, alarms={"structure": replace(quiet, about="q2")}, remainder=left), air),
        (replace(silent, findings=(at_q2,), remainder=left), "q2"),
        (replace(silent, findings=(gear_finding(),), remainder=left), "q1"),
        (replace(plain, remainder=left), "q1"),
    ):  # fmt: skip
        assert first(found) == driver


@pytest.mark.parametrize(
    ("slug", "place", "driver"),
    [
        ("transmission-error", ("q2",), "temperature.base"),
        ("transmission-error", ("q1",), "q2"),  # the term of another place
        ("backlash", ("q2",), "q2"),  # another effect's term
    ],
)
def test_a_finding_s_own_driver_goes_before_its_place(
    plain: Diagnosis, slug: str, place: tuple[str, ...], driver: str
) -> None:
    term: Any = SimpleNamespace(
        effect=SimpleNamespace(slug=slug), place=place, drivers=("temperature.base~60",)
    )
    finding = replace(gear_finding(), place=("q2",))
    assert first(replace(plain, findings=(finding,), terms=(term,))) == driver


def test_every_other_driver_is_folded_and_no_driver_stands_twice(plain: Diagnosis) -> None:
    found = blocks(plain)
    (signed,) = of(found, Fold)
    titles = {chart.x.title.split(" [")[0] for chart in of(signed.blocks, Charts)[0].charts}
    assert titles == {"q2", "temperature.base", "row in order of acquisition"}
    assert signed.title == "Signed residuals against every other driver"
    assert len(of(signed.blocks, Charts)[0].charts) == 9  # three axes each
    shape = of(found, Charts)[-1]
    assert [chart.title for chart in shape.charts] == ["", "normal plot"]


def test_rows_that_are_not_drawn_are_counted(plain: Diagnosis) -> None:
    assert " Of 30 rows 10 are drawn." in of(blocks(plain), Charts)[0].caption
    assert " are drawn" not in of(blocks(plain, np.arange(30)), Charts)[0].caption
    for chart in of(blocks(plain), Charts)[0].charts:
        assert all(len(layer.x) == 10 for layer in chart.layers if isinstance(layer, Marks))


def test_the_fit_after_is_drawn_where_an_effect_was_added(plain: Diagnosis) -> None:
    """Rows count that were fitted or held out, in both."""
    before, after = diagnosis_fits(plain)
    assert [(one.name, one.tone) for one in (before, after)] == [("before", "before"), ("after", "after")]
    assert before.residual is plain.before.residual and after.residual is plain.after.residual
    assert before.counts.all() and after.counts.all()  # 25 fitted, 5 held out
    used = np.arange(30) < 20
    own = diagnosis_fits(
        replace(plain, before=replace(plain.before, used=used), after=replace(plain.after, used=used))
    )
    for one in own:
        np.testing.assert_array_equal(one.counts, used | plain.recording.validation)
    assert [one.name for one in diagnosis_fits(replace(plain, terms=()))] == ["before"]


def test_nothing_fitted_nothing_drawn(plain: Diagnosis, machine: Machine) -> None:
    fits = [replace(one, counts=np.zeros(30, dtype=bool)) for one in diagnosis_fits(plain)]
    (text,) = residual_section(machine, plain.recording, fits, [], ROWS).blocks
    assert isinstance(text, Text) and text.text == "No row was fitted."
    some = [fits[0], diagnosis_fits(plain)[1]]
    assert len(residual_section(machine, plain.recording, some, [], ROWS).blocks) > 1
