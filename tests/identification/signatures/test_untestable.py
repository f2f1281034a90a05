"""What a recording cannot show, and the line of the file or the column that would: in the words that are told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.effect_machines import read_machines
from support.sensor_bench import ARM, HEAD
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.report.verdict import missing_words
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.untestable import (
    missing_inputs,
    missing_length,
    of_such_machines,
    still_sources,
    unloaded,
)
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

GRAVITY, MASSES = "gravity: [0, 0, -9.80665]\n", "masses: {head: {kg: 20, com: [0, 0, 0], in: tool}}\n"
ROWS = 6
ADD_GRAVITY = "add `gravity: [0, 0, -9.80665]`"
ADD_MASSES = "add `masses:` (kg, com and in: of links, platform, tool)"
WARMTH = (
    ("thermal-expansion",),
    "no temperature column",
    "log `temperature.air` or `temperature.base`; a thermometer elsewhere does, too",
)
SIDES = (
    ("backlash",),
    "no approach column, and the rows are declared shuffled",
    "log `approach.q1`, ... (+1 or -1: the direction of the joint's last motion)",
)
TIMES = ("mount-drift",), "no time column, and the rows are declared shuffled", "log `time` (s)"
SHUFFLED = "the rows are declared shuffled"


def arm(folder: Path, more: str = "") -> Machine:
    (folder / "arm.yaml").write_text(HEAD + ARM + more)
    return load_machine(folder / "arm.yaml")


def poses(
    machine: Machine, columns: Mapping[str, object] | None = None, *, shuffled: bool = False
) -> Recording:
    rng, told = np.random.default_rng(1), dict[str, object]()
    for actuator in machine.mechanism.actuators:
        low, high = actuator.range or (0.0, 1.0)
        told[f"{actuator.reading} [{actuator.reading_unit}]"] = rng.uniform(low, high, ROWS)
    told |= columns or {}
    return load_recording(machine, told, need_observations=False, shuffled=shuffled)


def told(machine: Machine, recording: Recording) -> list[tuple[tuple[str, ...], str, str]]:
    return [(m.effects, m.why, m.add) for m in missing_inputs(machine, recording)]


@pytest.mark.parametrize(
    ("more", "lacks"),
    [
        (
            "",
            [
                (("joint-compliance",), "no `gravity:` in arm.yaml", ADD_GRAVITY),
                (("gravity-sag", "link-bending"), "no `masses:` in arm.yaml", ADD_MASSES),
            ],
        ),
        (GRAVITY, [(("gravity-sag", "link-bending"), "no `masses:` in arm.yaml", ADD_MASSES)]),
        (
            MASSES,
            [(("gravity-sag", "joint-compliance", "link-bending"), "no `gravity:` in arm.yaml", ADD_GRAVITY)],
        ),
        (GRAVITY + MASSES, []),
    ],
)
def test_effects_of_weight_lack_what_the_file_does_not_state(
    tmp_path: Path, more: str, lacks: list[tuple[tuple[str, ...], str, str]]
) -> None:
    """A payload is a mass, too: what gives way to it needs gravity alone."""
    machine = arm(tmp_path, more)
    assert told(machine, poses(machine)) == [*lacks, WARMTH]


@pytest.mark.parametrize(
    ("without", "lacks"),
    [
        ((), []),
        (("gravity",), [(("gravity-sag", "leg-compliance"), "no `gravity:` in gough.yaml", ADD_GRAVITY)]),
        (
            ("masses",),
            [
                (
                    ("gravity-sag", "joint-compliance", "leg-compliance"),
                    "no `masses:` in gough.yaml",
                    ADD_MASSES,
                )
            ],
        ),
        (
            ("gravity", "masses"),
            [
                (
                    ("gravity-sag", "joint-compliance", "leg-compliance"),
                    "no `gravity:` and no `masses:` in gough.yaml",
                    f"{ADD_GRAVITY} and {ADD_MASSES.removeprefix('add ')}",
                )
            ],
        ),
    ],
)
def test_legs_give_way_and_are_no_links(
    tmp_path: Path, without: tuple[str, ...], lacks: list[tuple[tuple[str, ...], str, str]]
) -> None:
    machine = read_machines(tmp_path / "machines")["gough"]
    changed = replace(machine, gravity=None) if "gravity" in without else machine
    changed = replace(changed, masses=()) if "masses" in without else changed
    found = told(changed, poses(changed, {"temperature.air": np.ones(ROWS)}))
    assert found == lacks
    nameless = replace(changed, file=None)
    words = [why for _, why, _ in told(nameless, poses(changed))][: len(lacks)]
    assert words == [why.replace("gough.yaml", "the machine file") for _, why, _ in lacks]


@pytest.mark.parametrize(
    ("columns", "lacks"),
    [
        ((), [WARMTH, SIDES, TIMES]),
        (("temperature.air",), [SIDES, TIMES]),
        (("temperature.q3",), [SIDES, TIMES]),
        (("time",), [WARMTH, SIDES]),
        (("approach.q4",), [WARMTH, TIMES]),
    ],
)
def test_columns_that_nobody_logged_are_told_where_the_order_of_rows_tells_nothing(
    tmp_path: Path, columns: tuple[str, ...], lacks: list[tuple[tuple[str, ...], str, str]]
) -> None:
    """Any thermometer, and the side of any joint, is something. Rows in their order tell sides and times by themselves."""
    machine = arm(tmp_path, GRAVITY + MASSES)
    logged = {name: (-1.0) ** np.arange(ROWS) for name in columns}
    assert told(machine, poses(machine, logged, shuffled=True)) == lacks
    assert told(machine, poses(machine, logged)) == [one for one in lacks if one == WARMTH]


def test_a_load_that_nothing_can_have_is_told_by_what_is_stated(tmp_path: Path) -> None:
    bare, heavy = arm(tmp_path), arm(tmp_path, GRAVITY)
    assert unloaded(bare) == f"no `gravity:` in the machine file; {ADD_GRAVITY} (m/s^2, in the base's frame)"
    assert unloaded(heavy) == "no `masses:` in the machine file; state what links and tool weigh"
    whole = arm(tmp_path, GRAVITY + MASSES)
    assert unloaded(whole) == "its own elastic legs carry the weight"


def test_a_scale_of_lengths_is_asked_of_machines_that_have_free_lengths_alone(tmp_path: Path) -> None:
    machines = read_machines(tmp_path / "machines")
    for name, one in machines.items():
        lengths = any(p.unit == "mm" and p.tolerance > 0.0 for p in one.parameters)
        slides = any(a.unit == "mm" for a in one.mechanism.actuators)
        blind = replace(one, sensors=machines["mount"].sensors)
        assert bool(missing_length(blind)) is (lengths or slides) is (name != "mount")
        said = missing_words(missing_length(blind))
        assert all(line.startswith("a common scale: no sensor") for line in said)  # one slide's may be found
    assert not missing_length(machines["arm"])


def test_what_bends_telescopes_is_asked_of_machines_that_point(tmp_path: Path) -> None:
    machines = read_machines(tmp_path / "machines")
    pointing = {
        name: any(sensor.type == "direction" for sensor in one.sensors) for name, one in machines.items()
    }
    for name, one in machines.items():
        assert of_such_machines("axis-flexure", one) is pointing[name]
        assert of_such_machines("link-bending", one)
    (one,) = (machines[name] for name, points in pointing.items() if points)
    assert of_such_machines("axis-flexure", replace(one, sensors=(*one.sensors, *machines["arm"].sensors)))


@pytest.mark.parametrize("shuffled", [False, True])
def test_every_effect_says_at_which_places_it_lacks_what(tmp_path: Path, shuffled: bool) -> None:
    """The first four reasons in full, and how many more there are; what needs no column is never among them."""
    machine = arm(tmp_path)
    readings = {axis: np.zeros(ROWS) for axis in "xyz"}
    cat = catalogue(machine, poses(machine, readings, shuffled=shuffled))
    why = {one.effect: one.why for one in cat.untestable}
    assert len(why) == len(cat.untestable)
    assert why["latency"] == "no velocity.q1 column"
    assert why["zero-shift"] == why["frame-shift"] == "the recording holds one session only"
    warm = "; ".join(
        f"{place}: no temperature.{place} column" for place in ("base", "link1", "link2", "link3")
    )
    assert why["thermal-expansion"] == f"{warm}; and 3 more"
    for slug in ("joint-compliance", "link-bending", "gravity-sag"):
        assert why[slug] == unloaded(machine)
    assert "axis-flexure" not in why and "encoder-eccentricity" not in why
    of_order = {"backlash", "friction-hysteresis", "early-reading", "mount-drift"}
    assert (of_order & set(why)) == (of_order if shuffled else set())
    if shuffled:
        sides = [f"q{k}: no approach.q{k} column, and {SHUFFLED}" for k in (1, 2, 3, 4)]
        assert why["backlash"] == "; ".join([*sides, "and 2 more"])
        assert why["friction-hysteresis"].startswith(f"q1: {SHUFFLED}; q2: {SHUFFLED}; ")
        assert why["mount-drift"] == "base: no time column; tool: no time column"
    with_sessions = poses(machine, readings | {"session": np.arange(ROWS) // 3})
    assert "zero-shift" not in {one.effect for one in catalogue(machine, with_sessions).untestable}


def test_four_reasons_are_told_without_a_count_of_others(tmp_path: Path) -> None:
    """Of six joints two have their side of arrival."""
    machine = arm(tmp_path)
    sides = {f"approach.q{k}": (-1.0) ** np.arange(ROWS) for k in (1, 2)}
    cat = catalogue(machine, poses(machine, sides | {axis: np.zeros(ROWS) for axis in "xyz"}, shuffled=True))
    (why,) = (one.why for one in cat.untestable if one.effect == "backlash")
    assert why == "; ".join(f"q{k}: no approach.q{k} column, and {SHUFFLED}" for k in (3, 4, 5, 6))


@pytest.mark.parametrize(("travel", "digits", "free"), [(90.0, 3, True), (90.0, 0, False), (1e-3, 9, False)])
def test_nothing_is_a_function_of_what_hardly_varies(
    tmp_path: Path, travel: float, digits: int, free: bool
) -> None:
    """A joint that moves by a thousandth of a degree; a thermometer that varies by less than twenty of its last digit."""
    machine = arm(tmp_path)
    joint = machine.mechanism.readings[0]
    columns = {
        f"{joint} [rad]": np.radians(np.linspace(0.0, travel, ROWS)),
        "temperature.air": np.round(np.linspace(20.123, 29.234, ROWS), digits),
    }
    recording = poses(machine, columns)
    still = still_sources(machine, recording)
    assert (joint in still) is (travel < 1.0) and ("temperature.air" in still) is (digits == 0)
    forms = [c for c in catalogue(machine, recording).candidates if f"from.{joint}" in c.settings_map]
    assert bool(forms) is (travel > 1.0)
    warm = [c for c in catalogue(machine, recording).candidates if "temperature.air" in "".join(c.drivers)]
    assert bool(warm) is (digits > 0)
    assert free is not bool(still)


@pytest.mark.parametrize(
    ("levels", "free"), [((20, 26, 32), True), ((20, 23), True), ((20, 21, 26), False), ((20,), False)]
)
def test_levels_that_were_set_are_no_coarse_digits(
    tmp_path: Path, levels: tuple[int, ...], free: bool
) -> None:
    """Temperatures that a plan asks for may be whole kelvins; neighbouring values of a coarse thermometer differ by one."""
    machine = arm(tmp_path)
    recording = poses(machine, {"temperature.air": np.resize(np.array(levels, dtype=float), ROWS)})
    assert ("temperature.air" not in still_sources(machine, recording)) is free
