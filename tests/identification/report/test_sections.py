"""Sections of a diagnosis's report, block by block: what stands in each table, and when it is there at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from support.reports import NAN, gear_finding, of, rows, summary
from truepose.identification.diagnosis.alarm import Alarm
from truepose.identification.diagnosis.result import (
    UNNAMED,
    Alternative,
    Applied,
    Diagnosis,
    Finding,
    Form,
    Lead,
    Levels,
    PoseError,
    Proof,
    Quantity,
    Remainder,
    Together,
)
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.identification.report.finding_cards import finding_card, findings_section
from truepose.identification.signatures.untestable import Missing, Untestable
from truepose.shown.document import Block, Card, Charts, Fold, Items, Table, Text

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
    (list_,) = [items for items in of(blocks, Items) if items.title == "Leading, less probable than not"]
    assert len(list_.items) == 12
    assert not of(found(plain), Table)
    assert [items.title for items in of(found(plain), Items)][:1] == ["Why we say so"]


def test_texts_of_the_verdict_stand_where_they_have_something_to_say(plain: Diagnosis) -> None:
    warned = [text.text for text in of(found(plain), Text) if text.tone == "warn"]
    assert len(warned) == 1 and warned[0].startswith(
        "Concealed: an ordinary fit would have looked good (chi2/dof 1.02)"
    )
    assert not [text for text in of(found(replace(plain, concealed=False)), Text) if text.tone == "warn"]
    free = {key: fit for key, fit in plain.fits.items() if key != "free"}
    assert not [text for text in of(found(replace(plain, fits=free)), Text) if text.tone == "warn"]
    titles = [items.title for items in of(found(plain), Items)]
    worth = "What improved.yaml is worth to the tool"
    assert worth not in titles
    error = PoseError(0.5, 0.2)
    applied = Applied("whole", "role", error, 0.4, error, 0.4)
    assert worth in [items.title for items in of(found(replace(plain, applied=applied)), Items)]
    adequate = replace(plain, applied=applied, verdict="adequate", findings=())
    assert worth not in [items.title for items in of(found(adequate), Items)]
    lack = Missing(("joint-compliance",), "no `gravity:`", "add it")
    lists = of(found(replace(plain, missing=(lack,))), Items)
    (told,) = [
        one for one in lists if one.title == "What could not be tested, and what would make it testable"
    ]
    assert (
        list(told.items) == ["compliant joint (joint-compliance): no `gravity:`; add it"]
        and told.tone == "warn"
    )
    assert "What else could not be tested" in [one.title for one in lists]
    assert "What else could not be tested" not in [
        one.title for one in of(found(replace(plain, untestable=())), Items)
    ]
    outliers = [text.text for text in of(found(plain), Text) if text.text.startswith("Outliers")]
    assert len(outliers) == 1
    assert not [
        text for text in of(found(replace(plain, outlier_rows=())), Text) if text.text.startswith("Outliers")
    ]


def test_rows_set_aside_are_named_thirty_at_most() -> None:
    assert outlier_words([7]).startswith("Outliers: 1 row excluded as an outlier: row 7 (the first line")
    assert outlier_words([7]).endswith("put it so far from all others.")
    assert "3 rows excluded as outliers: rows 1, 2, 3 (" in outlier_words([1, 2, 3])
    assert ", 29, 30 and 1 more (the" in outlier_words(range(1, 32))
    assert "30 and" not in outlier_words(range(1, 31))
    assert fringe_words({3: -2, 7: 1}).endswith("whole half wavelengths: row 3 by -2, row 7 by +1.")


@pytest.mark.parametrize(
    ("gain", "said"),
    [
        ({}, ""),
        ({"position": 0.004}, " Modelling it lowers the rms of held-out rows by 4.00 µm (position) more."),
    ],
)
def test_what_remains_is_told_by_its_size_and_form(
    plain: Diagnosis, gain: dict[str, float], said: str
) -> None:
    left = Remainder(("q2",), "q2", Form("curve"), 2.1, gain)
    (text,) = [
        one.text
        for one in of(found(replace(plain, remainder=left)), Text)
        if one.text.startswith("What remains")
    ]
    assert text == (
        "What remains unexplained: residuals of 2.10 sigma rms, which seem to follow q2 (a hypothesis)."
        f" Form: q2 errs as a smooth curve in q2; hypothesised.{said}"
    )


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
    assert unsure.title == "q1 gives way under the load that it carries"
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
    blocks = evidence_section(replace(plain, candidates=forms)).blocks
    (fold,) = of(blocks, Fold)
    (table,) = of(fold.blocks, Table)
    assert rows(table) == [
        ["1", "backlash", "q1", "2", "7.00", "30 %"],
        ["2", "backlash", "q2", "1", "6.00", "40 %"],
    ]
    assert table.caption.startswith("The best 2 of 2 explanations")
    many = tuple(Alternative("backlash", (f"q{k}",), 0.0, float(k)) for k in range(17))
    (fold,) = of(evidence_section(replace(plain, candidates=many)).blocks, Fold)
    (table,) = of(fold.blocks, Table)
    assert len(table.rows) == 15 and table.caption.startswith("The best 15 of 17 explanations")
    assert not of(evidence_section(replace(plain, candidates=())).blocks, Fold)


def test_places_beyond_those_drawn_are_counted(plain: Diagnosis) -> None:
    for count, said in (
        (24, ""),
        (25, " The 1 weakest places are not shown."),
        (27, " The 3 weakest places are not shown."),
    ):
        own = replace(plain, evidence_map={f"q{k}": float(k) for k in range(count)})
        (charts,) = of(evidence_section(own).blocks, Charts)
        assert charts.caption.partition("partly imitate it.")[2] == said
    nothing = evidence_section(replace(plain, evidence_map={})).blocks
    assert not of(nothing, Charts) and of(nothing, Text)[0].text == "No explanation could be weighed."


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
    table = of(evidence_section(own).blocks, Table)[-1]
    assert [row[1:] for row in rows(table)] == [
        ["x", state, "9.00", "1.0×10⁻⁴"],
        ["y", "quiet", "0.500", "0.30"],
    ]


def test_the_posterior_is_told_by_sets_by_effects_and_by_places_together(plain: Diagnosis) -> None:
    sets = (plain.sets * 3)[:7]
    inclusion = tuple(Alternative("backlash", (f"q{k}",), 0.5, 0.0) for k in range(11))
    together = (Together("load", ("q1", "q2"), 0.98),)
    first, second, third = posterior_tables(replace(plain, sets=sets, inclusion=inclusion, together=together))
    assert len(first.rows) == 5 and rows(first)[2] == ["no effect", "1.0 %"]
    assert len(second.rows) == 10 and rows(second)[0] == ["backlash", "q0", "50 %"]
    assert second.caption.endswith(" 1 less probable one left out.")
    assert rows(third) == [["q1 or q2", "the weight carried", "98.0 %"]]
    assert [table.text_columns for table in (first, second, third)] == [1, 2, 2]
    (ten,) = posterior_tables(replace(plain, sets=(), inclusion=inclusion[:10]))
    assert ten.caption.endswith("together.")
    assert posterior_tables(replace(plain, sets=(), inclusion=())) == []


# -- the first screen ----------------------------------------------------------------------------------


def sure(diagnosis: Diagnosis) -> list[str]:
    (items,) = [one for one in diagnosis_opening(diagnosis).lists if one.title == "How sure"]
    return list(items.items)


def test_how_sure_findings_are_alike_ones_together(plain: Diagnosis) -> None:
    law = replace(gear_finding(), equivalents=())
    assert sure(replace(plain, findings=(law,)))[0].startswith("93.0 % that it is ")
    weak = replace(gear_finding(), probability=0.5, levels=LEVELS)
    (line,) = sure(replace(plain, findings=(weak, replace(weak, place=("q2",), probability=0.7))))
    assert line.endswith(
        "at q1 and q2: place 99.0 %, driver (the weight carried) 95.0 %, law 50 % to 70 %."
        " It could also be eccentric encoder disc (encoder-eccentricity)."
    )
    (bare,) = sure(replace(plain, findings=(replace(weak, levels=Levels()),)))
    assert bare.endswith(" at q1: 50 %. It could also be eccentric encoder disc (encoder-eccentricity).")
    unknown = replace(weak, levels=Levels(0.4, "load", 0.0))
    (half,) = sure(replace(plain, findings=(unknown, replace(weak, place=("q2",)))))
    assert ": place 40 % to 99.0 %, driver (the weight carried) " in half  # of one of them it is known
    (two,) = sure(replace(plain, findings=(law, replace(law, place=("q2",)))))
    assert two == "Transmission error of a geared joint (transmission-error) at q1 and q2: 93.0 %."
    (certain,) = sure(
        replace(plain, findings=(replace(weak, probability=0.95), replace(weak, probability=0.96)))
    )
    assert "It could also be" not in certain
    (left,) = sure(replace(plain, findings=(nameless(2),)))
    assert left == "Something without a name at q2: place 99.0 %, driver (the weight carried) 95.0 %."
    kinds = [nameless(2), weak, replace(weak, effect="backlash"), replace(weak, effect="latency", place=())]
    lines = sure(replace(plain, findings=tuple(kinds)))
    assert len(lines) == 4 and lines[-1] == "1 more below, in part 1."
    assert sure(replace(plain, findings=(), verdict="adequate"))[0].startswith("Nothing of the catalogue")
    assert sure(replace(plain, findings=(), verdict="unknown"))[0].startswith(
        "Something is missing; no place and no driver"
    )
    off = replace(plain, fits={**plain.fits, "after": summary(4.0, 1.2)})
    assert sure(off)[-1].startswith("Chi2 per degree of freedom 4.00, which speaks for ")


def test_lists_of_the_first_screen_are_short(plain: Diagnosis) -> None:
    proof = Proof("role", (), 0.9, (0.9, 1.05), 8.0, 0.8, False)
    own = replace(plain, proof=proof, untestable=tuple(Untestable(f"e{k}", f"reason {k}") for k in range(5)))
    lists = {one.title: list(one.items) for one in diagnosis_opening(own).lists}
    assert (
        len(lists["What speaks against it"]) == 3
        and lists["What speaks against it"][-1] == "2 more below, in part 1."
    )
    assert lists["What could not be tested"][-1] == "1 more below, in What the data cannot tell."
    calm = {one.title for one in diagnosis_opening(replace(plain, untestable=(), proof=None)).lists}
    assert calm == {"How sure"}


def steps(diagnosis: Diagnosis) -> list[str]:
    return [getattr(step, "command", "text") for step in diagnosis_opening(diagnosis).steps]


def test_steps_of_the_first_screen(plain: Diagnosis) -> None:
    error = PoseError(0.5, 0.2)
    applied = Applied("whole", "role", error, 0.4, error, 0.4)
    use = [
        "truepose codegen improved.yaml -o controller",
        "truepose compensate improved.yaml PATH -o commands.csv",
    ]
    check = "truepose check arm.yaml a&b.csv"
    plan = "truepose plan arm.yaml -n 40 -o poses.csv --diagnosis diagnosis.json"
    open_one = replace(gear_finding(), probability=0.8)
    assert steps(replace(plain, findings=(open_one,), applied=applied)) == [plan, "text", *use]
    assert steps(replace(plain, applied=applied)) == use
    assert steps(replace(plain, findings=(replace(open_one, equivalents=()),))) == []
    assert steps(replace(plain, findings=(), verdict="unknown")) == [check]
    assert steps(replace(plain, findings=(), verdict="adequate")) == use
    assert steps(replace(plain, applied=replace(applied, model="plain"))) == []
