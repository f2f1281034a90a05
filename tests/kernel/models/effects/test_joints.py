"""Effects of joints and mounts against what they stand for: scale, play, periods, coupling, drift, shifts."""

from __future__ import annotations

import numpy as np
import pytest

from support.effect_machines import READINGS, Machines
from support.effects import Campaign, Solved, position, shift_slopes, with_effect
from truepose.errors import InputError
from truepose.models.effects.base import effects
from truepose.models.effects.transmission_error import FADE
from truepose.models.machine.kinematics import symbolic_model


def test_a_scale_multiplies_the_reading_before_the_offset(machines: Machines) -> None:
    machine, q = machines["gough"], np.array(READINGS["gough"])
    s = 0.02
    one = position(machine, q, with_effect(machine, "actuator-scale", ("m3",), s=s))
    np.testing.assert_allclose(one, position(machine, q * (1 + s * (np.arange(6) == 2))), atol=1e-9)
    every = with_effect(machine, "actuator-scale", machine.mechanism.readings, s=s)
    np.testing.assert_allclose(position(machine, q, every), position(machine, q * (1 + s)), atol=1e-9)


@pytest.mark.parametrize("approach", [1.0, -1.0])
def test_backlash_leaves_the_joint_behind(machines: Machines, approach: float) -> None:
    arm, b = machines["arm"], 1e-3
    found = position(arm, [0.3, 0.2, 0.1], with_effect(arm, "backlash", ("q2",), b=b), approach=approach)
    np.testing.assert_allclose(found, position(arm, [0.3, 0.2 - b / 2 * approach, 0.1]), atol=1e-9)


def test_periodic_errors_have_their_period(machines: Machines) -> None:
    stage, arm = machines["stage"], machines["arm"]
    screw = with_effect(stage, "screw-periodic", ("s2",), {"harmonic": 2.0}, a=0.01, b=0.02)
    off = [position(stage, [0, s, 0], screw) - position(stage, [0, s, 0]) for s in (0.3, 2.3, 1.3)]
    np.testing.assert_allclose(off[0], off[1], atol=1e-10)  # half of a pitch of 4 mm
    np.testing.assert_allclose(off[0], -off[2], atol=1e-10)
    gear = with_effect(arm, "transmission-error", ("q1",), {"order": 7.0}, a=1e-3)
    expected = position(arm, [0.3 + 1e-3 * np.sin(2.1), 0.2, 0.1])
    np.testing.assert_allclose(position(arm, [0.3, 0.2, 0.1], gear), expected, atol=1e-9)
    again = shift_slopes(machines["gough"], with_effect(machines["gough"], "screw-periodic", ("m1",)))
    np.testing.assert_allclose(again["m1.displacement"], [0, 1], atol=1e-12)  # two whole turns of the motor


def test_a_series_says_nothing_beyond_the_arc_that_was_seen(machines: Machines) -> None:
    """On the arc it is itself less its mean there, whole turns away too; beyond its ends it fades, by half after 2 deg."""
    arm, effect = machines["arm"], effects.get("transmission-error", "test")()
    values = {f"{letter}{k}": 1e-3 / k for k in range(1, 61) for letter in "ab"}
    arc = effect.within(("q1",), {"orders": 60.0}, {"q1": (-1.0, 0.5)})
    assert arc == {"orders": 60.0, "from": -1.0, "to": 0.5}
    whole = with_effect(arm, "transmission-error", ("q1",), {"orders": 60.0}, **values)
    seen = with_effect(arm, "transmission-error", ("q1",), arc, **values)
    assert seen.label == whole.label

    def wave(angle: float) -> float:
        terms = [v * (np.sin if n[0] == "a" else np.cos)(int(n[1:]) * angle) for n, v in values.items()]
        return float(np.sum(terms))

    nodes, weights = np.polynomial.legendre.leggauss(90)  # half of the arc is 45 rad of the highest wave
    mean = float(weights @ np.array([wave(0.75 * t - 0.25) for t in nodes])) / 2
    assert abs(mean) > 1e-4
    inside = [(angle, 1.0) for angle in (-1.0, -0.3, 0.5, 0.1 - 2 * np.pi, 0.1 + 2 * np.pi)]
    fading = [(FADE, 0.5), (3 * FADE, 0.1), (1.0, 1 / (1 + (1.0 / FADE) ** 2))]
    outside = [(end, share) for beyond, share in fading for end in (0.5 + beyond, -1.0 - beyond)]
    for angle, share in inside + outside:
        off = share * (wave(angle) - mean)
        expected = position(arm, [angle + off, 0.2, 0.1])
        assert np.linalg.norm(expected - position(arm, [angle, 0.2, 0.1])) > 1e-3 * share
        np.testing.assert_allclose(position(arm, [angle, 0.2, 0.1], seen), expected, rtol=0.0, atol=1e-9)
    all_round = {"q1": (-3.5, 3.0)}
    assert effect.within(("q1",), {"orders": 60.0}, all_round) == {"orders": 60.0}
    assert effect.within(("q1",), {"order": 3.0}, {"q1": (-1.0, 0.5)}) == {"order": 3.0}


def test_a_series_is_the_sum_of_its_orders(machines: Machines) -> None:
    arm, q = machines["arm"], [0.7, 0.2, 0.1]
    amplitudes = {1: (4e-3, -2e-3), 2: (1e-3, 3e-3), 17: (5e-4, 2e-4), 60: (-3e-4, 1e-4)}
    values = {
        f"{letter}{k}": v for k, pair in amplitudes.items() for letter, v in zip("ab", pair, strict=True)
    }
    together = with_effect(arm, "transmission-error", ("q1",), {"orders": 60.0}, **values)
    single = [
        with_effect(arm, "transmission-error", ("q1",), {"order": float(k)}, a=a, b=b)
        for k, (a, b) in amplitudes.items()
    ]
    found = position(arm, q, together)
    np.testing.assert_allclose(found, position(arm, q, *single), atol=1e-9)
    assert np.linalg.norm(found - position(arm, q)) > 1.0
    assert len(together.coefficients) == 120
    scales = np.array([c.scale for c in together.coefficients])
    assert (np.diff(scales) <= 0).all()
    assert scales[-1] < 0.02 * scales[0]
    assert scales[0] == 6e-4  # 2 arcmin, what the catalogue states


def test_coupling_moves_the_driven_joint_by_the_driving_one(machines: Machines) -> None:
    stage, k = machines["stage"], 0.5
    placed = with_effect(stage, "axis-coupling", ("s1", "s3"), k=k)
    assert placed.coefficients[0].unit == "mm/rad"
    np.testing.assert_allclose(
        position(stage, [60, 13, 0.03], placed), position(stage, [60 + k * 0.03, 13, 0.03]), atol=1e-9
    )
    with pytest.raises(InputError, match="expected two joints: driven, driving"):
        with_effect(stage, "axis-coupling", ("s1",))


def test_mounts_drift_shift_and_settle(machines: Machines) -> None:
    arm, q = machines["arm"], [0.3, 0.2, 0.1]
    still = position(arm, q)
    steady = with_effect(arm, "mount-drift", ("base",), {"tau": 0.0, "start": 1000.0}, x=0.02)
    moved = position(arm, q, steady, time=1000 + 1800) - still
    np.testing.assert_allclose(moved, [0.01, 0, 0], atol=1e-9)
    settling = with_effect(arm, "mount-drift", ("base",), {"tau": 600.0, "start": 1000.0}, z=0.05)
    assert settling.coefficients[2].unit == "mm"
    assert position(arm, q, settling, time=1600)[2] - still[2] == pytest.approx(0.05 * (1 - np.exp(-1)))
    np.testing.assert_allclose(position(arm, q, settling, time=-1e9), still, atol=1e-12)  # it has not begun
    taus = [s["tau"] for s in settling.effect.settings(arm, ("base",), Campaign())]
    assert taus == [0, 580, 1100, 2200, 4300, 8600]  # of a campaign of 7200 s, neighbours twice as long
    bumped = with_effect(arm, "frame-shift", ("base",), {"session": 2.0}, y=0.3)
    assert bumped.drivers == ("session.after.2",)
    np.testing.assert_allclose(position(arm, q, bumped, session=1.0) - still, [0, 0.3, 0], atol=1e-9)
    np.testing.assert_allclose(position(arm, q, bumped, session=0.0), still, atol=1e-12)
    assert [s["session"] for s in bumped.effect.settings(arm, ("base",), Campaign())] == [1, 2]
    assert not bumped.effect.settings(arm, ("base",), Campaign(n_sessions=1))
    homed = with_effect(arm, "zero-shift", ("q2",), {"session": 1.0}, zero=0.01)
    np.testing.assert_allclose(position(arm, q, homed), position(arm, [0.3, 0.21, 0.1]), atol=1e-9)


@pytest.mark.parametrize("slug", ["frame-shift", "zero-shift"])
def test_a_machine_stands_as_its_latest_session_left_it(machines: Machines, slug: str) -> None:
    """Where no session is recorded every change between sessions lies in the past."""
    arm, q = machines["arm"], READINGS["arm"]
    place, value = (("base",), {"x": 2.0}) if slug == "frame-shift" else (("q2",), {"zero": 0.01})
    for session in (1.0, 2.0):
        moved = with_effect(arm, slug, place, {"session": session}, **value)
        model = symbolic_model(arm, (moved,))
        usual = Solved(model, q, **dict(zip(model.drivers, model.z_home.tolist(), strict=True))).position
        np.testing.assert_allclose(usual, position(arm, q, moved, session=1.0), atol=1e-12)
        assert np.linalg.norm(usual - position(arm, q, moved, session=0.0)) > 1.0
