"""Sections of a diagnosis's report, block by block: what stands in each table, and when it is there at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from support.reports import NAN, gear_finding, of, rows
from truepose.identification.diagnosis.alarm import Alarm
from truepose.identification.diagnosis.result import (
    UNNAMED,
    Alternative,
    Diagnosis,
    Finding,
    Lead,
    Levels,
    Quantity,
)
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.identification.report.finding_cards import finding_card, findings_section, matrix
from truepose.identification.report.weighing import weighing_section
from truepose.shown.chart import Cells
from truepose.shown.document import Block, Card, Fold, Items, Table, Text

LEVELS = Levels(0.99, "load", 0.95)


def found(diagnosis: Diagnosis) -> Sequence[Block]:
    return findings_section(diagnosis, np.arange(0, 30, 3)).blocks


# -- findings ------------------------------------------------------------------------------------------


def nameless(k: int, **more: Any) -> Finding:
    bare = replace(
        gear_finding(), effect="empirical", place=(f"q{k}",), equivalents=(), parameters={}, levels=LEVELS
    )
    return replace(bare, log_bayes_factor=40.0 + k, **more)


def test_what_has_no_name_is_a_row_with_its_number_and_what_leads_a_line(plain: Diagnosis) -> None:
    leads = tuple(Lead("backlash", (f"q{k}",), Levels(0.5, "load", 0.4), 0.3) for k in range(14))
    own = replace(plain, findings=(nameless(1), gear_finding(), nameless(2)), leading=leads)
    blocks = found(own)
    (table,) = of(blocks, Table)
    assert rows(table) == [
        ["1", "q1", "the weight carried", "99.0 %", "95.0 %", "41.0"],
        ["3", "q2", "the weight carried", "99.0 %", "95.0 %", "42.0"],
    ]
    (card,) = of(blocks, Card)
    assert card.number == 2
    assert not of(found(plain), Table)
    assert [items.title for items in of(found(plain), Items)][:1] == ["Why we say so"]


def card(plain: Diagnosis, finding: Finding) -> Card:
    made = finding_card(plain, finding, [], 4)
    assert made.number == 4 and made.slug == finding.effect
    return made


def test_a_card_says_what_it_is_how_large_how_sure_and_what_would_tell(plain: Diagnosis) -> None:
    own = replace(gear_finding(), flip_lambda=None)
    made = card(plain, own)
    assert (made.title, made.badge) == ("Transmission error of a geared joint at q1", "93.0 %")
    texts = [text.text for text in of(made.blocks, Text)]
    assert texts[0] == "The gear of joint q1 turns unevenly."
    assert texts[1] == "Size: a = 0.0003 ± 1e-05 rad, b = -0.0001 ± nan rad (likeliest explanation)."
    assert texts[2].startswith("How sure: Probability 93.0 % that it is ")
    assert texts[3] == "To tell them apart: sweep q1 alone; against encoder-eccentricity: turn the disc."
    assert of(made.blocks, Text)[-1].tone == "muted"
    bare = card(
        plain,
        replace(own, equivalents=(), experiment="sweep q1.", parameters={}, explanation="", flip_lambda=3.0),
    )
    texts = [text.text for text in of(bare.blocks, Text)]
    assert texts[0].startswith("How sure: ") and texts[1] == "To check it on the machine: sweep q1."
    assert (
        of(bare.blocks, Text)[-1].tone == "warn" and not of(bare.blocks, Table) and not of(bare.blocks, Fold)
    )
    silent = card(plain, replace(own, experiment="", equivalents=()))
    assert not [text for text in of(silent.blocks, Text) if text.text.startswith("To ")]
    unsure = card(plain, replace(own, probability=0.2, levels=LEVELS))
    assert unsure.title == "Something at q1 follows the weight carried"
    assert of(unsure.blocks, Text)[0].text.startswith("If it is ") and of(unsure.blocks, Text)[
        0
    ].text.endswith(": The gear of joint q1 turns unevenly.")


def test_a_class_stands_in_a_table_with_the_name_on_top(plain: Diagnosis) -> None:
    rivals = (*gear_finding().equivalents, Alternative(UNNAMED, ("q2",), 0.01, 1.0))
    (table,) = of(card(plain, replace(gear_finding(), equivalents=rivals)).blocks, Table)
    assert [row[1:] for row in rows(table)] == [
        ["q1", "(named above)", "93.0 %", "120"],
        ["q1", "turn the disc", "6.0 %", "118"],
        ["q2", "", "1.0 %", "1.00"],
    ]
    assert rows(table)[2][0] == "something without a name"
    assert rows(table)[1][0] == "eccentric encoder disc (encoder-eccentricity)"


def test_amplitudes_are_told_in_their_own_sigmas(plain: Diagnosis) -> None:
    sizes = {"a": Quantity(3e-4, 1e-5, "rad"), "b": Quantity(-1e-4, NAN, "rad"), "c": Quantity(2.0, 0.0, "1")}
    made = card(
        plain,
        replace(gear_finding(), parameters=sizes, settings=({"order": 2.0, "lag": 0.5}, {}, {"order": 3.0})),
    )
    (fold,) = of(made.blocks, Fold)
    assert fold.title == "Formula and 3 amplitudes"
    (table,) = of(fold.blocks, Table)
    assert rows(table) == [
        ["a", "300 ± 10 µrad", "30"],
        ["b", "-100.0 µrad (uncertainty unknown)", "-"],
        ["c", "2.000 (uncertainty unknown)", "-"],
    ]
    assert table.caption.startswith("Formula: ")
    assert table.caption.endswith(
        "Estimated in the fit with effects; setting order = 2, lag = 0.5; order = 3."
    )
    (fold,) = of(
        card(plain, replace(gear_finding(), parameters={"a": sizes["a"]}, settings=({},))).blocks, Fold
    )
    assert fold.title == "Formula and amplitude"
    assert of(fold.blocks, Table)[0].caption.endswith("Estimated in the fit with effects.")


# -- evidence ------------------------------------------------------------------------------------------


def test_forms_of_an_explanation_are_one_line_with_their_summed_probability(plain: Diagnosis) -> None:
    forms = (
        Alternative("backlash", ("q1",), 0.2, 5.0), Alternative("backlash", ("q1",), 0.1, 7.0),
        Alternative("backlash", ("q2",), 0.4, 6.0), Alternative("latency", ("q2",), 0.3, NAN),
    )  # fmt: skip
    blocks = weighing_section(replace(plain, candidates=forms)).blocks
    (fold,) = of(blocks, Fold)
    (table,) = of(fold.blocks, Table)
    assert rows(table) == [
        ["1", "backlash", "q1", "2", "7.00", "30 %"],
        ["2", "backlash", "q2", "1", "6.00", "40 %"],
    ]
    assert table.caption.startswith("The best 2 of 2 explanations")
    many = tuple(Alternative("backlash", (f"q{k}",), 0.0, float(k)) for k in range(17))
    (fold,) = of(weighing_section(replace(plain, candidates=many)).blocks, Fold)
    (table,) = of(fold.blocks, Table)
    assert len(table.rows) == 15 and table.caption.startswith("The best 15 of 17 explanations")
    assert not of(weighing_section(replace(plain, candidates=())).blocks, Fold)


@pytest.mark.parametrize(
    ("verdict", "terms", "after", "state"),
    [
        ("missing-physics", True, Alarm(1.0, 1e-4), "raised; still raised with what was found"),
        ("missing-physics", True, Alarm(1.0, 0.4), "raised; quiet with what was found"),
        ("missing-physics", False, Alarm(1.0, 0.4), "raised"),
        ("missing-physics", True, None, "raised"),
        ("adequate", True, Alarm(1.0, 0.4), "raised, but no explanation is likelier than none: noise of 1.2 and tolerances"
         " of 2.5 times the stated explain it"),
    ],
)  # fmt: skip
def test_what_became_of_an_alarm(
    plain: Diagnosis, verdict: str, terms: bool, after: Alarm | None, state: str
) -> None:
    own = replace(
        plain, verdict=verdict, noise=1.2, alarms={"residual": Alarm(9.0, 1e-4, "x"), "structure": Alarm(0.5, 0.3, "y")},
        alarms_after={} if after is None else {"residual": after}, terms=plain.terms if terms else (),
        inflation={PartClass("length", "a"): 1.5, PartClass("length", "b"): 2.5},
    )  # fmt: skip
    table = of(weighing_section(own).blocks, Table)[-1]
    assert [row[1:] for row in rows(table)] == [
        ["x", state, "9.00", "1.0×10⁻⁴"],
        ["y", "quiet", "0.500", "0.30"],
    ]


def test_an_ordinary_fit_that_would_have_looked_good_is_told(plain: Diagnosis) -> None:
    (warned,) = [text for text in of(found(plain), Text) if text.tone == "warn"]
    assert warned.text.startswith("Concealed: an ordinary fit would have looked good (chi2/dof 1.02)")
    free = {key: fit for key, fit in plain.fits.items() if key != "free"}
    for calm in (replace(plain, concealed=False), replace(plain, fits=free)):
        assert not [text for text in of(found(calm), Text) if text.tone == "warn"]


def test_the_posterior_is_told_by_sets_and_by_effects(plain: Diagnosis) -> None:
    sets = (plain.sets * 3)[:7]
    inclusion = tuple(Alternative("backlash", (f"q{k}",), 0.5, 0.0) for k in range(11))
    first, second, _ = of(weighing_section(replace(plain, sets=sets, inclusion=inclusion)).blocks, Table)
    assert len(first.rows) == 5 and rows(first)[2] == ["no effect", "1.0 %"]
    assert len(second.rows) == 10 and rows(second)[0] == ["backlash", "q0", "50 %"]
    assert second.caption.endswith(" 1 less probable one left out.")
    ten, _ = of(weighing_section(replace(plain, sets=(), inclusion=inclusion[:10])).blocks, Table)
    assert ten.caption.endswith("together.")


def test_a_matrix_has_its_numbers_where_there_is_room() -> None:
    for columns, numbers in ((8, True), (9, False)):
        values = np.arange(2.0 * columns).reshape(2, columns)
        chart = matrix(values, ["a", "b"], [f"q{k}" for k in range(columns)])
        (cells,) = of(chart.layers, Cells)
        np.testing.assert_array_equal(cells.values, values)
        assert [list(line) for line in cells.texts] == (
            [[f"{v:.2g}" for v in line] for line in values] if numbers else []
        )
