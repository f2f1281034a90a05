"""What is known of places and drivers: sums over all that agrees there, and one place that says it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support.effect_machines import read_machines
from support.searched_arm import PLAY, SCALE, searched
from truepose.identification.diagnosis.naming import Summary, summarised
from truepose.identification.diagnosis.posterior_summary import Presence, driver_of, parts_of
from truepose.identification.diagnosis.result import NAMED
from truepose.identification.diagnosis.search import Found
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.file.driver import Driver, DriverKind
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="module")
def found() -> Found:
    return searched(PLAY, SCALE)[1]


@pytest.fixture(scope="module")
def summary(found: Found) -> Summary:
    return summarised(found, found.fit)


@pytest.fixture(scope="module")
def presence(found: Found) -> Presence:
    return Presence(found.signatures.machine, found.catalogue, found.problem, found.posterior)


def test_no_level_is_less_probable_than_a_deeper_one(summary: Summary) -> None:
    assert {(n.cause.effect, n.cause.place) for n in summary.laws} == {
        ("backlash", ("q2",)),
        ("actuator-scale", ("q1",)),
    }
    for name in summary.names:
        assert name.probability <= name.levels.driver <= name.levels.place <= 1.0
        assert name.levels.driver > 0.9
        assert summary.inclusion.of(name.cause) == name.probability  # told with one value


def test_drivers_are_those_of_the_physics(summary: Summary) -> None:
    kinds = {n.cause.effect: n.levels.kind for n in summary.laws}
    assert kinds == {"backlash": "arrival", "actuator-scale": "position"}


def test_what_agrees_at_a_place_adds_up(found: Found, presence: Presence) -> None:
    """The share of all visited states with any term of that driver there: names, twins and forms without a name."""
    problem, total = found.problem, 0.0
    for state, share in found.posterior.states:
        every = [found.catalogue.candidates[problem.candidates[term]] for term, _ in state.members]
        total += share * any(e.place == ("q2",) and e.kind == "arrival" for e in every)
    assert presence.at(["q2"], "arrival") == pytest.approx(total, abs=1e-9)
    assert presence.at(["q2"]) >= presence.at(["q2"], "arrival")
    assert presence.at(["q1", "q2"]) <= min(presence.at(["q1"]), presence.at(["q2"]))


def test_a_wave_and_a_curve_of_the_own_position_are_one_driver(presence: Presence) -> None:
    assert driver_of("position-periodic") == driver_of("position") != driver_of("load")
    assert presence.at(["q1"], "position-periodic") == presence.at(["q1"], "position")


def test_parts_have_one_name_each(tmp_path: Path) -> None:
    machine = read_machines(tmp_path / "machines")["gough"]
    limb = machine.mechanism.limbs[0]
    assert parts_of(machine, "leg-compliance", (limb.name,)) == (limb.reading,)
    assert parts_of(machine, "wrong-constant", (f"{limb.name}.a.x",)) == (limb.reading,)
    assert parts_of(machine, "axis-coupling", ("q4", "q3")) == ("q4",)  # the one that is driven
    assert parts_of(machine, "gravity-sag", ("base",)) == ("base",)
    assert parts_of(machine, "zero-shift", ("q4", "q3", "q4")) == ("q4", "q3")
    encoded = read_machines(tmp_path / "machines")[
        "encoded"
    ]  # an encoder on a load side is a part of its own
    assert parts_of(encoded, "encoder-eccentricity", ("angle.q3",)) == ("angle.q3",)
    assert parts_of(encoded, "wrong-constant", ("q3.d",)) == ("q3",)


def test_what_is_not_there_leads_nothing() -> None:
    _, quiet = searched()
    said = summarised(quiet, quiet.fit)
    assert said.names == () and said.laws == ()
    assert all(max(one.levels.driver, one.certainty) < NAMED for one in said.leading)


# -- drivers as types ---------------------------------------------------------------------------------------------


def kinds_of(machine: Machine, slug: str) -> set[DriverKind]:
    effect = effects.get(slug, "test")()
    places = [tuple(place) for place in effect.places(machine)]
    return {PlacedEffect.at(effect, machine, place).kind for place in places}


@pytest.mark.parametrize(
    ("slug", "kind"),
    [
        ("joint-compliance", "load"),
        ("gravity-sag", "load"),
        ("link-bending", "load"),
        ("transmission-error", "position-periodic"),
        ("encoder-eccentricity", "position-periodic"),
        ("actuator-scale", "position"),
        ("backlash", "arrival"),
        ("friction-hysteresis", "arrival"),
        ("thermal-expansion", "temperature"),
        ("mount-drift", "time"),
        ("frame-shift", "session"),
        ("zero-shift", "session"),
        ("axis-coupling", "coupling"),
        ("sensor-scale", "sensor"),
        ("wrong-constant", "constant"),
    ],
)
def test_every_effect_states_its_driver(tmp_path: Path, slug: str, kind: DriverKind) -> None:
    found = set[DriverKind]()
    for machine in read_machines(tmp_path / "machines").values():
        found |= kinds_of(machine, slug)
    assert found == {kind}


def test_drivers_of_recordings_drive_in_their_own_way() -> None:
    names = (
        "payload",
        "temperature.leg1~300",
        "time",
        "approach.q2",
        "stop.q2~0.01",
        "session.after.2",
        "tilt",
    )
    assert [Driver.of(name).drives for name in names] == [
        "load", "temperature", "time", "arrival", "arrival", "session", None,
    ]  # fmt: skip


def test_forms_without_a_name_state_theirs(found: Found) -> None:
    kinds = {
        (e.place[0], tuple(k for k, _ in e.settings if k.startswith("from."))): e.kind
        for e in found.catalogue.candidates
        if e.effect.slug == "empirical"
    }
    assert kinds["q1", ("from.q1",)] == "position"
    assert kinds["q1", ("from.q2",)] == kinds["q1", ("from.q1", "from.q2")] == "coupling"
    assert {kind for (place, _), kind in kinds.items() if place == "sensor"} == {"sensor"}
    assert np.all([found.catalogue.candidates[i].kind != "sensor" for i in found.catalogue.smooth])
