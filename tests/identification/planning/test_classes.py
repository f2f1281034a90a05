"""What is to be told apart: explanations by name and from a diagnosis, and the experiment that is asked of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.experiments import UNEVEN, YIELDING, arm, poses
from truepose.errors import InputError
from truepose.identification.identifiability.note import Note
from truepose.identification.leaves.planning.discriminate.experiment import Experiment, discriminate
from truepose.identification.leaves.planning.discriminate.factors import (
    Class,
    Offer,
    Target,
    class_of,
    explanation,
)
from truepose.identification.leaves.planning.discriminate.race import recording_of
from truepose.models.machine.machine import Mass

QUANTITY = {"c": "rad/(N*m)", "b": "rad", "a": "rad", "s": "1"}


def equivalent(effect: str, place: str = "q2", **more: Any) -> dict[str, Any]:
    return {"effect": effect, "place": [place], "probability": 0.3, **more}


def finding(effect: str, place: str, parameters: Mapping[str, float], **more: Any) -> dict[str, Any]:
    """A finding with these values, each in the unit of its coefficient."""
    values = {n: {"value": v, "std": 1e-9, "unit": QUANTITY[n[0]]} for n, v in parameters.items()}
    return {
        "effect": effect,
        "place": [place],
        "parameters": values,
        "settings": [{}],
        "equivalents": [],
        **more,
    }


YIELDS = finding("joint-compliance", "q2", {"c": 2e-5}, equivalents=[equivalent("transmission-error")])
PLAY = finding("backlash", "q3", {"b": 3e-4}, equivalents=[equivalent("friction-hysteresis", "q3")])
ALONE = finding("actuator-scale", "q1", {"s": 1e-3})


def diagnosed(folder: Path, *findings: Mapping[str, Any]) -> Path:
    (folder / "diagnosis.json").write_text(json.dumps({"findings": findings}), encoding="utf-8")
    return folder / "diagnosis.json"


def names(found: Class) -> list[str]:
    return [one.name for one in found.explanations]


def test_the_first_finding_with_equivalents_is_told_from_them(tmp_path: Path) -> None:
    found = class_of(diagnosed(tmp_path, ALONE, YIELDS, PLAY), arm())
    assert names(found) == ["joint-compliance@q2", "transmission-error@q2"]
    assert found.explanations[0].amplitude == pytest.approx([0.2])  # of the scale of 1e-4 rad/(N m)
    assert found.explanations[1].amplitude is None
    assert [part.label for part in found.others] == ["actuator-scale@q1", "backlash@q3"]
    assert found.notes == (Note("own class", "backlash@q3"),)


def test_findings_that_are_named_are_told_from_the_other_names(tmp_path: Path) -> None:
    file = diagnosed(tmp_path, ALONE, YIELDS, PLAY)
    found = class_of(file, arm(), ["actuator-scale@q3", "backlash@q3"])
    assert names(found) == ["backlash@q3", "actuator-scale@q3"] and found.notes == ()
    assert found.explanations[0].amplitude == pytest.approx([0.1])
    assert [part.label for part in found.others] == ["actuator-scale@q1", "joint-compliance@q2"]
    alone = class_of(file, arm(), ["backlash@q3"])  # then its own equivalents are meant
    assert names(alone) == ["backlash@q3", "friction-hysteresis@q3"]
    both = class_of(file, arm(), ["backlash@q3", "joint-compliance@q2", "backlash@q2"])
    assert names(both) == ["joint-compliance@q2", "backlash@q3", "backlash@q2"]
    with pytest.raises(
        InputError, match="no finding with the name of backlash@q2 or actuator-scale@q2, expected"
    ):
        class_of(file, arm(), ["backlash@q2", "actuator-scale@q2"])


@pytest.mark.parametrize(
    ("more", "noted"),
    [((), False), ((equivalent("unknown"),), True), ((equivalent("backlash", tested=False),), True)],
)  # fmt: skip
def test_equivalents_without_a_name_or_that_were_not_tried_are_noted(
    tmp_path: Path, more: tuple[dict[str, Any], ...], noted: bool
) -> None:
    one = {**YIELDS, "equivalents": [*more, equivalent("transmission-error", tested=True)]}
    found = class_of(diagnosed(tmp_path, one), arm())
    assert names(found) == ["joint-compliance@q2", "transmission-error@q2"]
    assert found.notes == ((Note("nameless", "joint-compliance@q2"),) if noted else ())
    named = class_of(diagnosed(tmp_path, one), arm(), ["joint-compliance@q2", "backlash@q2"])
    assert names(named) == ["joint-compliance@q2", "backlash@q2"] and named.notes == ()


def test_what_is_no_explanation_is_passed_over(tmp_path: Path) -> None:
    """Forms without a name, rows, and effects of a plug-in that is not loaded."""
    strange = [{**ALONE, "effect": effect} for effect in ("outliers", "empirical", "of-a-plug-in")]
    found = class_of(diagnosed(tmp_path, *strange, YIELDS), arm())
    assert names(found) == ["joint-compliance@q2", "transmission-error@q2"] and found.others == ()


def test_terms_of_several_orders_act_together_and_so_may_their_equivalent(tmp_path: Path) -> None:
    values = {"a[order=2]": 3e-4, "b[order=2]": 0.0, "a[order=5]": 0.0, "b[order=5]": -6e-4}
    orders = {"settings": [{"order": 2.0}, {"order": 5.0}]}
    equivalents = [equivalent("encoder-eccentricity"), equivalent("joint-compliance")]
    one = finding("transmission-error", "q2", values, equivalents=equivalents, **orders)
    found = class_of(diagnosed(tmp_path, one), arm())
    true, encoder, yields = found.explanations
    labels = ["transmission-error@q2,order=2", "transmission-error@q2,order=5"]
    assert [[part.label for part in form] for form in true.forms] == [labels]
    assert true.amplitude == pytest.approx([0.1, 0.0, 0.0, -0.2])
    assert len(yields.forms) == len(explanation("joint-compliance@q2", arm()).forms)
    single = [form for form in encoder.forms if len(form) == 1]
    together = [form for form in encoder.forms if len(form) > 1]
    known = {part.settings_map.get("order") for form in single for part in form}
    assert len(together) == int({2.0, 5.0} <= known) and len(encoder.forms) == len(single) + len(together)
    if together:
        assert encoder.forms[0] == together[0]
        assert [part.settings_map["order"] for part in together[0]] == [2.0, 5.0]
    del one["parameters"]["b[order=5]"]
    with pytest.raises(
        InputError, match=r"findings\[1\]: found no value of b\[order=5\] in rad, expected one"
    ):
        class_of(diagnosed(tmp_path, ALONE, one), arm())


def test_a_value_in_another_unit_is_none(tmp_path: Path) -> None:
    one = finding("backlash", "q3", {"b": 1e-4})
    one["parameters"]["b"]["unit"] = "deg"
    with pytest.raises(InputError, match=r"diagnosis.json: findings\[0\]: found no value of b in rad"):
        class_of(diagnosed(tmp_path, one), arm())


@pytest.mark.parametrize("text", ["{", "[]", '{"findings": 3}', '{"found": []}'])
def test_a_file_that_is_no_diagnosis_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "d.json").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"d\.json: found no `findings`"):
        class_of(tmp_path / "d.json", arm())
    with pytest.raises(InputError, match=r"none\.json: cannot read the file: No such file or directory"):
        class_of(tmp_path / "none.json", arm())


@pytest.mark.parametrize(
    ("text", "forms", "amplitude"),
    [
        ("transmission-error@q2:order=2", ["order=2"], None),
        ("transmission-error@q2:a=3e-4, order=2", ["order=2"], [0.1, 0.0]),
        ("joint-compliance@q2", ["", "bend=2", "bend=3"], None),
        ("joint-compliance@q2:c=1e-5", ["", "bend=2", "bend=3"], [0.1]),
        ("backlash@q3:b=6e-4", [""], [0.2]),
    ],
)
def test_an_explanation_may_have_every_setting_that_is_not_named(
    text: str, forms: list[str], amplitude: list[float] | None
) -> None:
    found = explanation(text, arm())
    assert [form[0].label.partition(",")[2] for form in found.forms] == forms
    assert (None if found.amplitude is None else found.amplitude.tolist()) == pytest.approx(amplitude)


def test_a_series_of_the_gear_and_of_the_encoder_are_twins_at_one_joint() -> None:
    series, encoder, other, one = (
        explanation(text, arm())
        for text in ("transmission-error@q2:orders=60", "encoder-eccentricity@q2:order=1",
                     "encoder-eccentricity@q3:order=1", "transmission-error@q2:order=1")
    )  # fmt: skip
    assert series.twin_of(encoder) and encoder.twin_of(series)
    assert not series.twin_of(other) and not one.twin_of(encoder) and not series.twin_of(one)


# -- the experiment ------------------------------------------------------------------------------------


def asked(*texts: str, n: int = 5, **options: Any) -> Experiment:
    machine = options.pop("machine", arm())
    wanted = options.pop("wanted", None) or Class(tuple(explanation(text, machine) for text in texts))
    return discriminate(machine, n, wanted, candidates=poses(machine, 12), **options)


def test_an_experiment_says_how_far_it_is_and_is_the_same_from_the_same_seed() -> None:
    heard = list[str]()
    payload = Offer.of(arm(), "0,5")
    found = asked(YIELDING, UNEVEN, offer=payload, progress=heard.append)
    assert heard == [
        "looking at candidates", "looking at what they would tell", "choosing rows", "weighing what is varied",
    ]  # fmt: skip
    again, other = (asked(YIELDING, UNEVEN, offer=payload, seed=seed) for seed in (0, 1))
    assert again.seed == found.seed == 0 and other.seed == 1
    np.testing.assert_array_equal(again.rows.q, found.rows.q)
    np.testing.assert_array_equal(again.random, found.random)
    assert not np.array_equal(other.random, found.random) and len(found.random) == 20
    assert found.reference is None and found.already is None and len(found.rows) == 5


@pytest.mark.parametrize(
    ("texts", "n", "says"),
    [
        ((YIELDING,), 5, "expected two or more different explanations"),
        ((YIELDING, YIELDING, UNEVEN), 5, "expected two or more different explanations"),
        ((YIELDING, UNEVEN), 1, "found 1 rows, expected at least 2"),
    ],
)
def test_what_cannot_be_told_apart_is_refused(texts: tuple[str, ...], n: int, says: str) -> None:
    with pytest.raises(InputError, match=says):
        asked(*texts, n=n)
    assert len(asked(YIELDING, UNEVEN, n=2).rows) == 2


def test_a_payload_is_hung_on_where_loads_matter_and_the_file_has_none() -> None:
    bare = replace(arm(), masses=tuple(mass for mass in arm().masses if mass.name != "payload"))
    hung = Mass("payload", 0.0, (0.0, 0.0, 0.0), "tool")
    payload, silent = Offer.of(bare, "0,5"), Offer({})
    for machine, texts, offer, masses, notes in (
        (bare, (YIELDING, UNEVEN), payload, (*bare.masses, hung), (Note("payload"),)),
        (bare, (YIELDING, UNEVEN), silent, (*bare.masses, hung), ()),
        (bare, ("backlash@q2", UNEVEN), payload, bare.masses, (Note("unread", "payload"),)),
        (arm(), (YIELDING, UNEVEN), payload, arm().masses, ()),
    ):
        found = asked(*texts, machine=machine, offer=offer, n=2)
        assert found.machine.masses == masses and found.notes == notes


@pytest.mark.parametrize(
    ("driver", "unread"),
    [
        ("temperature.link2", False),
        ("temperature.air", False),
        ("pressure", True),
        ("temperature.link3", True),
    ],
)
def test_offers_that_no_explanation_reads_are_noted(driver: str, unread: bool) -> None:
    """One thermometer in the air stands for all places."""
    offer = Offer({driver: (15.0, 25.0)})
    found = asked("thermal-expansion@link2:alpha=1e-5", "backlash@q3", offer=offer, n=3)
    assert [note for note in found.notes if note.kind == "unread"] == [Note("unread", driver)] * unread


def test_rows_are_measured_in_an_order_that_changes_seldom_what_takes_long() -> None:
    texts = ("mount-drift@base", "frame-shift@base", "backlash@q1", YIELDING)
    found = asked(*texts, n=14, offer=Offer.of(arm(), "0,2,5"))
    slow = ("session", "time", "payload", "approach.q1")
    order = [
        (*(float(found.rows.drivers[name][k]) for name in slow), *found.rows.q[k].tolist()) for k in range(14)
    ]
    assert order == sorted(order)
    assert all(len(set(found.rows.drivers[name])) > 1 for name in slow[:3])


def test_a_plan_adds_to_the_rows_that_exist() -> None:
    wanted = Class(tuple(explanation(text, arm()) for text in (YIELDING, UNEVEN)))
    payload = Offer.of(arm(), "0,5")
    first = asked(wanted=wanted, n=6, offer=payload)
    recorded = recording_of(arm(), first.rows, poses(arm(), 1)[0])
    found = asked(wanted=wanted, n=3, offer=payload, recorded=recorded)
    assert found.already is not None
    assert 0.0 < first.expected <= found.already < found.expected
    with pytest.raises(InputError, match="--target: found the sensor position"):
        asked(wanted=wanted, n=3, targets=[Target("T1", (0.0, 0.0, 1.0))])


def test_the_pairs_that_no_row_tells_apart_do_not_count_for_the_worst() -> None:
    """Play and friction look alike; both are told from a gain."""
    found = asked("friction-hysteresis@q2:h=1e-3,width=0", "backlash@q2:b=1e-3", "actuator-scale@q2:s=1e-3")
    stuck = {frozenset((pair.true.slug, pair.rival.slug)) for pair in found.stuck}
    assert stuck == {frozenset(("friction-hysteresis", "backlash"))}
    assert all((pair.expected == 0.0) is not pair.separable for pair in found.pairs)
    assert found.expected == min(pair.expected for pair in found.pairs if pair.separable) > 0.0
    assert not found.hopeless and not found.splits
