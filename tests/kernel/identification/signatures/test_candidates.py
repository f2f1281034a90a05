"""What a recording could speak of: forms without a name, the ranges that they are over, and shares of the prior."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.searched_arm import ARM
from support.simulated import machine_from
from truepose.identification.prior import ELSEWHERE
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import (
    Catalogue,
    catalogue,
    empirical_forms,
    forms_of_held_load,
    forms_of_load,
    ranges,
)
from truepose.identification.signatures.linearisation import Linearisation
from truepose.models.effects.base import Settings
from truepose.models.effects.empirical import Empirical
from truepose.models.effects.polynomials import WIDTH, seen_over
from truepose.models.machine.machine import Machine

ROWS = 40
HEAVY = "gravity: [0, 0, -9.80665]\nmasses: {head: {kg: 20, com: [0, 0, 0], in: tool}}\n"


def arm(folder: Path, more: str = "") -> Machine:
    return machine_from(folder, ARM + more, "arm")


def rows(machine: Machine, **columns: object) -> Recording:
    """Poses with readings that go up to 700 mm; the last ten for validation, where all is twice as much."""
    rng = np.random.default_rng(2)
    twice = np.where(np.arange(ROWS) < 30, 1.0, 2.0)
    told: dict[str, object] = {"q1 [rad]": rng.uniform(-1.0, 1.0, ROWS) * twice}
    told |= {"q2 [rad]": rng.uniform(-0.8, 0.8, ROWS) * twice}
    told |= {axis: rng.uniform(-300.0, 300.0, ROWS) for axis in "xy"}
    told["z"] = np.where(np.arange(ROWS) == 5, -700.0, 10.0)
    told["role"] = np.where(np.arange(ROWS) < 30, "calibration", "validation")
    return load_recording(machine, told | columns)


# -- forms without a name -----------------------------------------------------------------------------------------


def test_ranges_are_those_of_calibration_rows_and_of_their_order_without_a_clock(tmp_path: Path) -> None:
    machine = arm(tmp_path)
    recording = rows(machine, payload=np.arange(float(ROWS)))
    found, own = ranges(machine, recording), ~recording.validation
    assert set(found) == {"q1", "q2", "payload", "row"}
    for name, values in (("q1", recording.q[own, 0]), ("q2", recording.q[own, 1])):
        assert found[name] == (values.min(), values.max())
    assert found["payload"] == (0.0, 29.0)
    clocked = rows(machine, time=60.0 * np.arange(ROWS))
    assert "row" not in ranges(machine, clocked) and ranges(machine, clocked)["time"] == (0.0, 1740.0)


def test_forms_are_lines_and_curves_of_all_that_varies_at_every_element(tmp_path: Path) -> None:
    """Joints by their displacement and by all six motions, by their reading with the side of arrival; thermometers last."""
    machine = arm(tmp_path)
    n = np.arange(float(ROWS))
    recording = rows(
        machine,
        time=n,
        payload=n % 5,
        **{"temperature.air": 20.05 + n % 7, "temperature.q1": np.full(ROWS, 20.0)},
        **{"approach.q1": np.where(n % 2 > 0, 1.0, -1.0), "approach.q2": np.ones(ROWS)},
    )
    seen = ranges(machine, recording)
    joints, others = ["q1", "q2"], ["payload", "time", "temperature.air"]
    sources = [*joints, *others]  # a thermometer that never changes is none
    forms = empirical_forms(machine, recording)
    expected = []
    for place in ("q1", "q2"):
        expected += [((place,), seen_over({name: seen[name]}, 1)) for name in sources]
        for spatial in (False, True):  # with corners in its own reading, where laws have them
            curves = [
                seen_over({name: seen[name]}, degree, spatial=spatial)
                for name in sources
                for degree in ((2,) if spatial else (2, 12 if name == place else 4))
            ]
            expected += [((place,), one) for one in curves]
    # q2 always arrived from the same side
    expected.append((("q1",), seen_over({"q1": seen["q1"], "approach.q1": (-1.0, 1.0)}, 2)))
    for place in ("base", "tool"):
        expected += [((place,), seen_over({name: seen[name]}, 3)) for name in sources]
    expected.append((("sensor",), {WIDTH: 700.0}))
    told = [(form.place, dict(form.settings_map)) for form in forms]
    assert len(told) == len(expected) == len({form.label for form in forms})
    assert all(one in told for one in expected)
    order = [next(iter(d)) for form in forms if form.place == ("base",) and (d := form.drivers)]
    assert order == others


def volume(machine: Machine, recording: Recording) -> Settings:
    """Settings of the sensor's form that is a function of nothing recorded."""
    own = [f.settings_map for f in empirical_forms(machine, recording) if f.place == ("sensor",)]
    (found,) = (settings for settings in own if WIDTH in settings)
    return found


def test_a_volume_is_as_wide_as_the_farthest_reading(tmp_path: Path) -> None:
    """A lost reading says nothing of it."""
    machine = arm(tmp_path)
    lost = rows(machine, z=np.where(np.arange(ROWS) == 5, np.nan, -450.0))
    for recording, width in ((rows(machine), 700.0), (lost, 450.0)):
        assert volume(machine, recording) == {WIDTH: width}
    blind = replace(rows(machine), observations={})
    nowhere = rows(machine, **{axis: np.zeros(ROWS) for axis in "xyz"})
    for recording in (blind, nowhere):  # no reach is no width: it is divided by
        assert volume(machine, recording) == {WIDTH: 1.0}


def test_loads_range_over_what_the_weight_makes_of_the_poses(tmp_path: Path) -> None:
    """By the drawing: 20 kg on 300 mm about q2, whose axis is 50 mm off, and 40 mm to the side; N m. q1 carries nothing."""
    machine = arm(tmp_path, HEAVY)
    recording = rows(machine)
    q2 = recording.q[~recording.validation, 1]
    lever = 0.3 * np.cos(q2)
    force = 20.0 * 9.80665
    found = forms_of_load(machine, recording)
    assert set(found) == {"q2", "base", "tool"}
    assert [form["degree"] for form in found["q2"]] == [1.0, 2.0, 12.0]
    joint = found["q2"][-1]
    ends = sorted(abs(value) for name, value in joint.items() if name != "degree")
    assert ends == pytest.approx(sorted([force * lever.min(), force * lever.max()]), rel=1e-6)
    assert joint["from.load"] < joint["to.load"]
    each, size = found["base"]
    arm_ = np.hypot(0.05 + lever, 0.04)
    assert (size["from.moment"], size["to.moment"]) == pytest.approx((force * arm_.min(), force * arm_.max()))
    assert max(abs(each["from.load"]), abs(each["to.load"])) <= force * arm_.max() * (1.0 + 1e-9)
    assert forms_of_load(arm(tmp_path), recording) == {}


def test_what_a_drive_holds_is_a_source_of_its_own_joint(tmp_path: Path) -> None:
    machine = arm(tmp_path)
    n = np.arange(float(ROWS))
    recording = rows(
        machine, **{"torque.q1": n - 5.0, "current.q2": 3.0 * n, "torque.q2": np.full(ROWS, 7.0)}
    )
    found = forms_of_held_load(machine, recording, ())
    assert found == {
        "q1": [seen_over({"torque.q1": (-5.0, 24.0)}, degree) for degree in (1, 2, 12)],
        "q2": [seen_over({"current.q2": (0.0, 87.0)}, degree) for degree in (1, 2, 12)],
    }
    assert set(forms_of_held_load(machine, recording, {"torque.q1"})) == {"q2"}
    for step, told in ((1e-6, False), (1e-2, True)):  # a millionth of it is rounding
        steady = replace(recording, drivers={"torque.q1": 700.0 + step * n})
        assert bool(forms_of_held_load(machine, steady, ())) is told
    silent = replace(recording, drivers={"payload": n, "torque.q9": n})
    assert forms_of_held_load(machine, silent, ()) == {}


# -- shares of the prior ------------------------------------------------------------------------------------------


def share(cat: Catalogue, slug: str, place: str, driver: str) -> float:
    """Prior of an effect at a place by one column, whatever else it depends on."""
    return sum(
        float(np.exp(log))
        for c, log in zip(cat.candidates, cat.log_prior, strict=True)
        if c.effect.slug == slug and c.place == (place,) and any(d.startswith(driver) for d in c.drivers)
    )


def test_a_thermometer_elsewhere_has_a_fifth_of_a_place_that_has_its_own(tmp_path: Path) -> None:
    """However many there are; and the whole prior of all candidates stays one."""
    machine, n = arm(tmp_path), np.arange(float(ROWS))
    own = {"temperature.base": 20.05 + n % 7}
    for others in (1, 2):
        more = {f"temperature.q{k}": 21.0 + (k + 2) * np.sin(k * n) for k in range(1, others + 1)}
        cat = catalogue(machine, rows(machine, **own, **more))
        borrowed = share(cat, "thermal-expansion", "base", "temperature.q")
        itself = share(cat, "thermal-expansion", "base", "temperature.base")
        assert borrowed > 0.0
        assert borrowed / (borrowed + itself) == pytest.approx(ELSEWHERE)
        assert np.sum(np.exp(cat.log_prior)) <= 1.0 + 1e-9


def test_what_is_added_beside_a_candidate_shares_its_prior(tmp_path: Path) -> None:
    """Equally with those that it stands beside; nothing else moves, and new ones stand at the end."""
    machine = arm(tmp_path)
    cat = catalogue(machine, rows(machine))
    beside = [1, 4]
    added = [
        replace(cat.candidates[1], spread=2.0),
        replace(cat.candidates[4], spread=3.0),
        cat.candidates[0],
    ]
    more = cat.with_more(added, beside)
    before, after = np.exp(cat.log_prior), np.exp(more.log_prior)
    assert more.candidates == (*cat.candidates, *added)
    five = [*beside, *range(len(before), len(after))]
    np.testing.assert_allclose(after[five], (before[1] + before[4]) / 5.0)
    rest = [k for k in range(len(before)) if k not in beside]
    np.testing.assert_allclose(after[rest], before[rest])
    assert (more.stated, more.untested, more.untestable) == (cat.stated, cat.untested, cat.untestable)


def test_effects_that_the_file_states_are_candidates_that_are_no_question(tmp_path: Path) -> None:
    stated = "effects: [{effect: actuator-scale, place: [q1], parameters: {s: 0.002}}]\n"
    machine = arm(tmp_path, stated)
    cat = catalogue(machine, rows(machine))
    assert [cat.candidates[k].label for k in cat.stated] == ["actuator-scale@q1"]
    assert len({c.label for c in cat.candidates}) == len(cat.candidates)
    assert all(cat.named(k) is (c.effect.slug != Empirical.slug) for k, c in enumerate(cat.candidates))
    assert all(cat.named(k) is cat.has_law(k) for k in range(len(cat.candidates)))  # nothing is assumed
    bare = catalogue(arm(tmp_path), rows(machine))
    assert bare.stated == ()


# -- linearised problems ------------------------------------------------------------------------------------------


def test_parts_of_a_linearisation_are_those_of_all_its_channels_together() -> None:
    """Two kinds of channel; without effects, geometry and residual are left as they were."""
    rng = np.random.default_rng(1)
    first, second = (rng.standard_normal((n, 6)) for n in (20, 30))
    grams = first.T @ first, second.T @ second
    both = np.vstack([first, second])
    columns = slice(0, 1), slice(1, 3)
    lin = Linearisation(grams, (20, 30), 2, columns, np.arange(5.0), np.ones(2), (), ())
    np.testing.assert_allclose(lin.gram, both.T @ both)
    some, others = np.array([3, 0]), np.array([5, 1, 2])
    np.testing.assert_allclose(lin.among(some, some), (both.T @ both)[np.ix_(some, some)])
    np.testing.assert_allclose(lin.among(some, others), both[:, some].T @ both[:, others])
    assert lin.n_observations == 50
    assert lin.indices([1, 0]) == [1, 2, 0]
    bare = lin.bare()
    kept = both[:, [0, 1, 5]]
    np.testing.assert_allclose(bare.gram, kept.T @ kept)
    assert bare.columns == () and bare.candidates == ()
    np.testing.assert_array_equal(bare.departure, [0.0, 1.0])
