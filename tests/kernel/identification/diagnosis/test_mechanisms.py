"""The diagnosis on small recordings whose truth is not the catalogue's formula but a mechanism of its own.

Heat follows its thermometer through a simulated body, a gear stiffens, a platform bends like a beam; the engine has to name
and place them and get sign and size right.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from support.shifting_bench import Bench, clock, the_only


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, int], Bench]:
    folder = tmp_path_factory.mktemp("benches")
    return lambda name, seed: Bench(folder, name, seed)


def test_a_body_that_lags_its_thermometer_is_thermal_expansion(bench: Callable[[str, int], Bench]) -> None:
    """The column follows the air with a lag that the catalogue does not have; its length is 400 mm."""
    arm, rows, lag, alpha = bench("arm", 7), 60, 1300.0, 2.0e-5
    seconds = clock(rows, 90.0)
    air = 20 + 6 * np.sin(seconds / 1500) + 4 * (seconds > 3000)
    body = np.empty(rows)
    body[0] = air[0]
    for k in range(1, rows):  # small explicit steps between the rows
        fine, here = np.linspace(air[k - 1], air[k], 50), body[k - 1]
        for outside in fine:
            here += (90.0 / 50) / lag * (outside - here)
        body[k] = here
    frame = arm.frame(
        arm.readings(rows),
        shifts={"q1.r": 400 * alpha * (body - 20)},
        time=seconds,
        **{"temperature.base": air},
    )
    finding = the_only(arm.diagnose(frame), "thermal-expansion", "base")
    assert finding.parameters["alpha"].value == pytest.approx(alpha, rel=0.25)
    assert finding.settings[0]["lag"] > 0


def test_a_gear_that_stiffens_is_a_compliant_joint(bench: Callable[[str, int], Bench]) -> None:
    """Torque winds the joint up, less and less as it grows."""
    arm, rows = bench("arm", 8), 60
    q, kg = arm.readings(rows), np.tile([0.0, 4.0, 8.0], rows // 3)
    torque = -9.80665 * kg * 0.5 * np.cos(q[:, 1])
    yields = 8e-6 * torque / (1 + np.abs(torque) / 150)
    frame = arm.frame(q, q + np.outer(yields, [0, 1]), payload=kg)
    # the load hangs at the end of the one link that the joint carries, whose far half is the tool
    finding = the_only(arm.diagnose(frame), "joint-compliance", "q2", alike=("link-bending", "gravity-sag"))
    c = finding.parameters["c"]
    assert c.unit == "rad/(N*m)"
    assert 5e-6 < c.value < 8e-6


@pytest.mark.nightly
def test_slack_that_weight_takes_up_is_not_surely_a_compliant_joint(
    bench: Callable[[str, int], Bench],
) -> None:
    """Bends of the compliance follow it, but they carry so much of it that the form is another."""
    arm, rows = bench("arm", 8), 60
    q, kg = arm.readings(rows), np.tile([0.0, 4.0, 8.0], rows // 3)
    torque = -9.80665 * kg * 0.5 * np.cos(q[:, 1])
    frame = arm.frame(q, q + np.outer(3e-4 * np.tanh(torque / 5.0), [0, 1]), payload=kg)
    found = arm.diagnose(frame)
    assert found.verdict != "adequate"
    assert all(f.probability < 0.9 for f in found.findings if f.effect == "joint-compliance")


@pytest.mark.nightly
def test_a_sigma_that_is_stated_too_small_takes_no_name_away(bench: Callable[[str, int], Bench]) -> None:
    """Most of the misfit is noise then, which no effect explains; it speaks against none."""
    arm, rows = bench("arm", 11), 240
    q, kg = arm.readings(rows), np.tile([0.0, 4.0, 8.0], rows // 3)
    torque = -9.80665 * kg * 0.5 * np.cos(q[:, 1])
    frame = arm.frame(q, q + np.outer(5e-6 * torque, [0, 1]), payload=kg)
    frame[["x [mm]", "y [mm]", "z [mm]"]] += arm.rng.normal(0.0, 0.023, (rows, 3))
    found = arm.diagnose(frame)
    after, before = (found.fits[stage].chi2_per_dof for stage in ("after", "before"))
    assert after > 4.0 and before - after < 0.5 * (before - 1.0)
    (finding,) = found.findings
    names = {finding.effect, *(other.effect for other in finding.equivalents)}
    assert "joint-compliance" in names
    assert finding.certainty > 0.45


@pytest.mark.nightly
def test_a_platform_that_bends_like_a_beam_is_named(bench: Callable[[str, int], Bench]) -> None:
    """Each leg lifts its own end; the others follow with the squared cosine of the angle between them."""
    hexapod, rows = bench("hexapod", 9), 40
    q = hexapod.readings(rows)
    ends = [hexapod.machine.geometry[f"leg{k}.b.{c}"].nominal for k in range(1, 7) for c in "xy"]
    x, y = np.reshape(ends, (6, 2)).T
    angle = np.arctan2(y, x)
    follow = np.cos(angle[:, None] - angle) ** 2 - 0.4
    lift = 0.01 * q @ follow.T
    frame = hexapod.frame(q, shifts={f"leg{k + 1}.b.z": lift[:, k] for k in range(6)})
    found = hexapod.diagnose(frame)
    finding = the_only(found, "platform-deformation", "platform")
    own = [v.value for name, v in finding.parameters.items() if name in ("kappa", "K[1,1]")]
    assert own[0] > 0
    assert found.evidence_map["platform"] == max(found.evidence_map.values())
