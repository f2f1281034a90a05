"""Arms of public packages moved in MuJoCo: the same arms as their machine files, and rest as statics has it. m, N, rad."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from support.skips import NO_MUJOCO

if find_spec("mujoco") is None or find_spec("robosuite") is None:
    pytest.skip(NO_MUJOCO, allow_module_level=True)

import mujoco

from challenge.mujoco import arms, chain, motion, packages
from challenge.mujoco.arms import MujocoArm
from challenge.mujoco.mjcf import RATE, STEP, Bend, Build, Yielding
from challenge.mujoco.motion import Way, driven
from challenge.simulator.base import Campaign, Imperfection, Kind, Plan, Specimen
from challenge.simulator.writing import recording_text
from truepose.errors import InputError
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

Array = NDArray[np.float64]
ARMS: tuple[MujocoArm, ...] = tuple(arm() for arm in arms.machines().values())
every_arm = pytest.mark.parametrize("arm", ARMS, ids=lambda a: str(a.name))
UR5E = next(arm for arm in ARMS if arm.arm == "ur5e")
STATICS_IN_MOTION = 2e-7
"""m between what is driven and left to settle for a third of a second and what is balanced: a hundredth of a sigma."""


def poses(arm: MujocoArm, n: int, seed: int = 3) -> Array:
    low, high = arm.drawing.ranges.T
    return np.random.default_rng(seed).uniform(low, high, (n, len(low)))


def way(q: Array, payload: float = 0.0, side: float = 1.0) -> Way:
    return Way(q, q - side * arms.OVERSHOOT, np.full(len(q), payload))


def build(arm: MujocoArm) -> Build:
    return arm.drawing.build({})


def rigid(b: Build, q: Array) -> Array:
    """(n, 4, 4) of the tool, by the rows alone."""
    return np.array([chain.pose(b.rows, row) @ b.tool for row in q])


def weights(b: Build, q: Array, payload: float = 0.0) -> list[tuple[float, Array]]:
    """kg and centres (3,) at joints (nq,), by the rows alone."""
    frames = [np.eye(4)]
    for step in chain.transforms(b.rows, q):
        frames.append(frames[-1] @ step)
    hand = frames[-1] @ b.tool
    out = []
    for body, (kg, centre) in b.masses.items():
        frame = hand if body in ("tool", "payload") else frames[int(body.removeprefix("link"))]
        out.append((payload if body == "payload" else kg, (frame @ np.append(centre, 1.0))[:3]))
    return out


def energy(b: Build, q: Array, payload: float) -> float:
    """Of the weight, N m."""
    return -sum(kg * float(b.gravity @ centre) for kg, centre in weights(b, q, payload))


def torque(b: Build, q: Array, joint: int, payload: float) -> float:
    """Of the weight about a joint: minus the slope of its energy. The step keeps both errors below 1e-8 of it."""
    step = 1e-5 * np.eye(len(q))[joint]
    return (energy(b, q - step, payload) - energy(b, q + step, payload)) / 2e-5


def drawn(arm: MujocoArm, plan: Plan | None = None, seed: int = 5) -> tuple[Specimen, Campaign]:
    rng = np.random.default_rng(seed)
    return arm.specimen(rng), arm.campaign(plan or Plan(poses=12, repeats=2), rng)


class TestTheSameArm:
    def test_at_least_three_arms_of_six_or_seven_joints(self) -> None:
        assert len(ARMS) >= 3
        assert {len(arm.readings) for arm in ARMS} <= {6, 7}

    @every_arm
    def test_rows_place_the_tip_where_the_package_does(self, arm: MujocoArm) -> None:
        package = packages.read(arm.arm)
        fitted = chain.fitted(package)
        for q in poses(arm, 20):
            found = fitted.base @ chain.pose(fitted.rows, q) @ fitted.flange_tip
            np.testing.assert_allclose(found, package.pose(q), atol=1e-14)

    @every_arm
    def test_masses_hang_where_the_package_has_them(self, arm: MujocoArm) -> None:
        """Weight of the package's arm alone, by MuJoCo, against rows and masses of the drawing."""
        package = packages.read(arm.arm)
        bare = replace(
            build(arm), masses={k: v for k, v in build(arm).masses.items() if k.startswith("link")}
        )
        model = package.model
        gravity = np.linalg.norm(bare.gravity)
        model.opt.gravity[:] = [0, 0, -gravity]
        data = mujoco.MjData(model)
        for q in poses(arm, 5):
            data.qpos[package.addresses] = q
            data.qvel[:] = 0
            mujoco.mj_forward(model, data)
            found = [torque(bare, q, k, 0.0) for k in range(len(q))]
            # fingers that a package's wrist carries are no part of the arm; none of these has any
            np.testing.assert_allclose(found, -data.qfrc_bias[package.addresses], atol=1e-6)

    @every_arm
    def test_the_machine_file_reads_as_mujoco_does(self, arm: MujocoArm, tmp_path: Path) -> None:
        """A specimen with all its errors, to 1e-9 of the 2 m from instrument to tool; files hold 1e-9 mm and deg."""
        specimen, campaign = drawn(arm)
        exact = arm.measure(specimen, (), campaign)
        (tmp_path / "machine.yaml").write_text(arm.machine_text(), encoding="utf-8")
        text = recording_text(arm, campaign, exact)
        (tmp_path / "recording.csv").write_text(text, encoding="utf-8")
        machine = load_machine(tmp_path / "machine.yaml")
        predictor = Predictor(machine, load_recording(machine, [tmp_path / "recording.csv"]))
        assert set(specimen.parameters) == {p.name for p in machine.parameters if p.tolerance}
        p = np.array([specimen.parameters[name] for name in predictor.model.names])
        blocks = predictor.blocks(p, predictor.assemble(p)[0], np.ones(len(campaign), dtype=bool))
        off = (
            np.concatenate([b.residual.reshape(-1, len(arm.columns)) for b in blocks]) * arm.instrument.sigmas
        )
        assert np.abs(off[:, :3]).max() < 2e-6
        assert np.abs(off).max() < 2e-6

    @every_arm
    def test_the_built_model_is_rigid_where_nothing_yields(self, arm: MujocoArm) -> None:
        q = poses(arm, 10)
        np.testing.assert_allclose(driven(build(arm), Yielding(), way(q)), rigid(build(arm), q), atol=1e-14)

    def test_axes_that_are_nearly_parallel_are_refused(self) -> None:
        package = packages.read("ur5e")
        axes = package.axes.copy()
        axes[2] += 1e-6 * axes[0]
        with pytest.raises(InputError, match=r"axes 2 and 3 parallel to 1\.0e-06"):
            chain.fitted(replace(package, axes=axes / np.linalg.norm(axes, axis=1, keepdims=True)))

    def test_what_is_not_installed_is_said(self, monkeypatch: pytest.MonkeyPatch) -> None:
        with pytest.raises(InputError, match="found arm 'scara', expected one of ur5e"):
            packages.read("scara")
        monkeypatch.setattr(packages, "find_spec", lambda _: None)
        assert packages.installed() == ()
        with pytest.raises(InputError, match=r"no package 'robosuite'.*pip install '\.\[mujoco\]'"):
            packages.read("ur5e")
        with pytest.raises(InputError, match="found no arm"):
            arms.machines()


class TestRest:
    @every_arm
    def test_a_joint_gives_way_by_the_torque_of_the_bent_arm(self, arm: MujocoArm) -> None:
        b, q, joint, stiffness, payload = build(arm), poses(arm, 6), 1, 2e4, 1.5
        found = driven(b, Yielding(springs={joint: stiffness}), way(q, payload))
        bent = q.copy()
        for row, start in zip(bent, q, strict=True):
            for _ in range(20):
                row[joint] = start[joint] + torque(b, row, joint, payload) / stiffness
        np.testing.assert_allclose(found, rigid(b, bent), atol=1e-11)
        assert np.abs(bent - q).max() > 1e-5

    def test_a_base_turns_by_the_moment_of_what_it_carries(self) -> None:
        """Soft about x only: the turn is that of one more joint there."""
        b, q, soft = build(UR5E), poses(UR5E, 4), 1e5
        found = driven(b, Yielding(mounts={"base": (soft, 1e12, 1e12)}), way(q))
        still = rigid(b, q)
        for row, tool, free in zip(q, found, still, strict=True):
            turn = tool @ np.linalg.inv(free)
            centres = weights(b, row)
            moment = sum(np.cross(turn[:3, :3] @ at, kg * b.gravity)[0] for kg, at in centres)
            assert np.arctan2(turn[2, 1], turn[2, 2]) == pytest.approx(moment / soft, rel=1e-6)

    @pytest.mark.parametrize(("pieces", "deflection"), [(1, 1 / 4), (2, 1 / 3)])
    def test_a_cut_link_bends_as_a_cantilever(self, pieces: int, deflection: float) -> None:
        """Level link of L with a weight F at its end: F L^3 / 3 E I and F L^2 / 2 E I; one cut reaches 1/4 of it."""
        length, kg, ei = 0.7, 3.0, 1e6
        rows = np.zeros((2, 5))
        rows[1, 2] = length
        nothing = (0.0, np.zeros(3))
        masses = {"link1": nothing, "link2": nothing, "tool": (kg, np.zeros(3)), "payload": nothing}
        b = Build(rows, np.eye(4), masses, np.array([0, 0, -9.81]))
        (tool,) = driven(b, Yielding(bends={1: Bend(ei, pieces, False)}), way(np.zeros((1, 2))))
        force = kg * 9.81
        # a joint's mass without weight of its own is 1e-9 kg
        assert tool[2, 3] == pytest.approx(-deflection * force * length**3 / ei, rel=1e-6)
        assert tool[2, 0] == pytest.approx(-force * length**2 / 2 / ei, rel=1e-6)

    @pytest.mark.parametrize("twists", [False, True])
    def test_a_link_twists_as_a_round_tube(self, twists: bool) -> None:
        length, kg, ei, lever = 0.5, 2.0, 1e6, 0.2
        rows = np.zeros((2, 5))
        rows[1, 2] = length
        nothing = (0.0, np.zeros(3))
        aside = (kg, np.array([0.0, lever, 0.0]))
        b = Build(
            rows,
            np.eye(4),
            {"link1": nothing, "link2": nothing, "tool": aside, "payload": nothing},
            np.array([0, 0, -9.81]),
        )
        (tool,) = driven(b, Yielding(bends={1: Bend(ei, 2, twists)}), way(np.zeros((1, 2))))
        expected = -kg * 9.81 * lever * length * 1.3 / ei if twists else 0.0
        assert tool[2, 1] == pytest.approx(expected, rel=1e-5, abs=1e-12)

    def test_one_joint_follows_another(self) -> None:
        q, ratio = poses(UR5E, 5), 1e-3
        followed = q.copy()
        followed[:, 5] += ratio * q[:, 3]
        found = driven(build(UR5E), Yielding(couplings={(5, 3): ratio}), way(q))
        # the belt of 1e8 N m/rad gives way by 1e-8 rad under 1 N m, half a metre from the tool
        np.testing.assert_allclose(found, rigid(build(UR5E), followed), atol=1e-8)

    def test_what_is_driven_comes_to_the_same_rest(self) -> None:
        """Friction of nothing in one joint makes the campaign a motion; all else is where statics has it."""
        q, springs = poses(UR5E, 8), {1: 3e4, 2: 2e4}
        still = Yielding(
            springs, bends={2: Bend(3e4, 2, True)}, mounts={"base": (1e6,) * 3, "tool": (3e4,) * 3}
        )
        moved = replace(still, friction={2: 1e-9})
        assert moved.remembers
        assert not still.remembers
        balanced, rested = (driven(build(UR5E), y, way(q, 2.0)) for y in (still, moved))
        np.testing.assert_allclose(rested, balanced, atol=STATICS_IN_MOTION)

    def test_too_soft_is_refused(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(tmp_path)  # MuJoCo writes a log where it stands
        with pytest.raises(ValueError, match="no rest"):
            driven(build(UR5E), Yielding(springs={1: 1.0}), way(poses(UR5E, 3)))


def test_a_motion_that_is_lost_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo would start anew at zero, and say so in a log only."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="no rest in the motion"):
        driven(build(UR5E), Yielding(gaps={0: 1e-4}, friction={0: 1.0}), way(np.full((1, 6), np.nan)))


def turned(joint: int, found: Array, q: Array) -> Array:
    """(n,) by how much a joint of the UR5e stands beside its reading, from the tool."""
    b, out = build(UR5E), []
    for tool, row in zip(found, q, strict=True):
        ahead = np.eye(4)
        for step in chain.transforms(b.rows, row)[: joint + 1]:
            ahead = ahead @ step
        turn = (
            ahead[:3, :3].T
            @ tool[:3, :3]
            @ (np.linalg.inv(ahead) @ chain.pose(b.rows, row) @ b.tool)[:3, :3].T
        )
        out.append(np.arctan2(turn[1, 0], turn[0, 0]))
    return np.array(out)


class TestMemory:
    @pytest.mark.parametrize("joint", [0, 2, 5])
    def test_friction_winds_a_drive_up_from_behind(self, joint: int) -> None:
        """A drive that bears the weight itself stands back by friction over stiffness, on the side it came from."""
        q, stiffness, rub = poses(UR5E, 6), 2e5, 20.0
        fed = Yielding({joint: stiffness}, friction={joint: rub}, fed=frozenset({joint}))
        for side in (1.0, -1.0):
            off = turned(joint, driven(build(UR5E), fed, way(q, side=side)), q)
            # gravity differs by a few percent over the overshoot, MuJoCo's friction creeps by less
            np.testing.assert_allclose(off, -side * rub / stiffness, rtol=0.05)

    def test_play_lies_where_friction_leaves_it(self) -> None:
        q, play = poses(UR5E, 6), 4e-4
        y = Yielding(gaps={0: play}, friction={0: 30.0})
        for side in (1.0, -1.0):
            off = turned(0, driven(build(UR5E), y, way(q, side=side)), q)
            np.testing.assert_allclose(off, -side * play / 2, rtol=1e-3)

    def test_play_lies_where_the_weight_puts_it(self) -> None:
        q, play = poses(UR5E, 8), 4e-4
        pushed = np.array([torque(build(UR5E), row, 1, 0.0) for row in q])
        q = q[np.abs(pushed) > 3.0]
        pushed = pushed[np.abs(pushed) > 3.0]
        assert len({*np.sign(pushed)}) == 2
        y = Yielding(gaps={1: play}, friction={1: 1.0})
        for side in (1.0, -1.0):
            off = turned(1, driven(build(UR5E), y, way(q, side=side)), q)
            np.testing.assert_allclose(off, np.sign(pushed) * play / 2, rtol=1e-2)

    def test_a_small_move_back_does_not_cross_the_play(self) -> None:
        """The states go from row to row: a joint that goes back by half its play leaves the link where it was."""
        q = np.tile(poses(UR5E, 1), (2, 1))
        q[1, 0] -= 2e-4
        start = np.stack([q[0] - arms.OVERSHOOT, q[0]])
        y = Yielding(gaps={0: 4e-4}, friction={0: 30.0})
        found = driven(build(UR5E), y, Way(q, start, np.zeros(2)))
        np.testing.assert_allclose(found[1], found[0], atol=1e-7)

    def test_only_what_remembers_asks_for_the_order(self) -> None:
        q = poses(UR5E, 6)
        y = Yielding({1: 2e4}, mounts={"base": (1e6,) * 3})
        np.testing.assert_array_equal(
            driven(build(UR5E), y, way(q))[::-1], driven(build(UR5E), y, way(q[::-1]))
        )


CASES = [(arm, kind) for arm in ARMS for kind in arm.kinds()]


class TestKinds:
    @pytest.mark.parametrize(("arm", "kind"), CASES, ids=lambda x: str(x.name))
    def test_every_kind_shows_and_its_absence_does_not(self, arm: MujocoArm, kind: Kind) -> None:
        specimen, campaign = drawn(arm, Plan(poses=6, repeats=2))
        clean = arm.measure(specimen, (), campaign)
        for place in kind.places:
            one = Imperfection(
                kind.name, place, kind.typical, arm.shape(kind.name, place, np.random.default_rng(2))
            )
            np.testing.assert_array_equal(arm.measure(specimen, (one.scaled(0.0),), campaign), clean)
        change = arm.measure(specimen, (one,), campaign) - clean
        assert np.isfinite(change).all()
        assert np.abs(change / arm.instrument.sigmas).max() > 1e-3
        np.testing.assert_array_equal(arm.measure(specimen, (one,), campaign) - clean, change)

    def test_gears_turn_the_link_by_their_waves(self) -> None:
        specimen, campaign = drawn(UR5E)
        one = Imperfection("encoder-eccentricity", ("q2",), 1e-3, {"phase1": 0.7})
        moved = campaign.q.copy()
        moved[:, 1] += 1e-3 * (np.sin(moved[:, 1] + 0.7) - np.sin(0.7))
        by_hand = UR5E.measure(specimen, (), replace(campaign, q=moved))
        np.testing.assert_allclose(UR5E.measure(specimen, (one,), campaign), by_hand, atol=1e-9)

    def test_all_at_once(self) -> None:
        """Every kind of the catalogue, each somewhere, in one model."""
        specimen, campaign = drawn(UR5E, Plan(poses=10, repeats=2))
        rng = np.random.default_rng(4)
        several = tuple(
            Imperfection(
                k.name, (place := k.places[n % len(k.places)]), k.typical, UR5E.shape(k.name, place, rng)
            )
            for n, k in enumerate(UR5E.kinds())
        )
        together = UR5E.measure(specimen, several, campaign) - UR5E.measure(specimen, (), campaign)
        alone = [
            UR5E.measure(specimen, (i,), campaign) - UR5E.measure(specimen, (), campaign) for i in several
        ]
        assert np.isfinite(together).all()
        assert np.abs(together).max() > max(np.abs(one).max() for one in alone) / 3

    def test_unknown_kinds_and_places_are_refused(self) -> None:
        specimen, campaign = drawn(UR5E, Plan(poses=3, repeats=1))
        for wrong in (("rust", ("q1",)), ("joint-compliance", ("q9",))):
            with pytest.raises(ValueError, match="expected a kind and place"):
                UR5E.measure(specimen, (Imperfection(*wrong, 1.0),), campaign)


class TestCampaigns:
    @every_arm
    def test_the_instrument_adds_its_noise(self, arm: MujocoArm) -> None:
        specimen, campaign = drawn(arm, Plan(poses=60, repeats=2))
        exact = arm.measure(specimen, (), campaign)
        noise = arm.noisy(exact, campaign, np.random.default_rng(1), factor=2.0) - exact
        # 120 rows of 3 columns: the standard deviation is known to 4 %
        assert np.std(noise[:, :3]) == pytest.approx(2 * arm.instrument.sigma, rel=0.15)

    def test_without_overshoot_a_joint_comes_from_where_it_was(self) -> None:
        straight = type(UR5E)(straight=True)
        _, campaign = drawn(straight)
        moves = np.diff(campaign.q, axis=0)
        np.testing.assert_array_equal(campaign.approach[1:], np.where(moves < 0, -1.0, 1.0))

    @every_arm
    def test_poses_stand_clear_of_the_ground(self, arm: MujocoArm) -> None:
        specimen, campaign = drawn(arm)
        tools = driven(arm.drawing.build(specimen.parameters), Yielding(), way(campaign.q))
        up = -arm.drawing.gravity / np.linalg.norm(arm.drawing.gravity)
        assert (tools[:, :3, 3] @ up).min() > 0.0


def test_springs_are_given_time_to_settle() -> None:
    """Of the deflection on arrival, less than a thousand-millionth is left when a row is read."""
    since = RATE * STEP * motion.WAITING
    assert (1 + since) * np.exp(-since) < 1e-9
