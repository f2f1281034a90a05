"""Laws of the simulated telescope, nanopositioner and polisher. mm, N, rad."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from challenge.simulator import (
    nanopositioner_physics,
    polisher_physics,
    telescope_geometry,
    telescope_physics,
)
from challenge.simulator.base import Campaign, Imperfection, Kind, Plan, Specimen
from challenge.simulator.cavity import Constants
from challenge.simulator.mechanism_frames import fixed
from challenge.simulator.nanopositioner import Nanopositioner
from challenge.simulator.polisher import Polisher
from challenge.simulator.ported import PortedMachine, Work
from challenge.simulator.telescope import Telescope, TelescopeTargets
from challenge.simulator.writing import recording_text
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

Array = NDArray[np.float64]
MACHINES: tuple[PortedMachine, ...] = (Telescope(), TelescopeTargets(), Nanopositioner(), Polisher())
KINDS = [(machine, kind) for machine in MACHINES for kind in machine.kinds()]
every_machine = pytest.mark.parametrize("machine", MACHINES, ids=lambda m: m.name)
PLAN = Plan(poses=10, repeats=2, sessions=2)
EXACT = 1e-9
"""mm and rad between two solvers that both stop below 1e-11, on coordinates of up to 2000 mm."""


def measured(machine: PortedMachine, plan: Plan = PLAN, seed: int = 5) -> tuple[Specimen, Campaign, Array]:
    """A specimen, a campaign, and readings with nothing missing."""
    rng = np.random.default_rng(seed)
    specimen, campaign = machine.specimen(rng), machine.campaign(plan, rng)
    return specimen, campaign, machine.measure(specimen, (), campaign)


def of_kind(machine: PortedMachine, kind: Kind, place: int = 0, seed: int = 1) -> Imperfection:
    """A kind at its typical size at one of its places."""
    chosen = kind.places[place % len(kind.places)]
    shape = machine.shape(kind.name, chosen, np.random.default_rng(seed))
    return Imperfection(kind.name, chosen, kind.typical, shape)


def assembled(machine: PortedMachine, campaign: Campaign, specimen: Specimen) -> Work:
    """The work of a campaign with its solution and nothing missing."""
    values = {name: np.full(len(campaign), value) for name, value in specimen.parameters.items()}
    work = Work(campaign, values, np.zeros_like(campaign.q))
    work.solved = machine.solve(work)
    return work


@every_machine
def test_with_nothing_missing_the_drawings_model_is_exact(machine: PortedMachine, tmp_path: Path) -> None:
    specimen, campaign, exact = measured(machine)
    (tmp_path / "machine.yaml").write_text(machine.machine_text(), encoding="utf-8")
    (tmp_path / "r.csv").write_text(recording_text(machine, campaign, exact), encoding="utf-8")
    drawn = load_machine(tmp_path / "machine.yaml")
    predictor = Predictor(drawn, load_recording(drawn, [tmp_path / "r.csv"]), ())
    assert np.abs(predictor.q - campaign.q).max() < EXACT
    predictor.q = campaign.q  # a file holds nine decimals
    p = np.array(predictor.model.p_home, dtype=float)
    for k, name in enumerate(predictor.model.names):
        if name in machine.drawing:
            assert machine.drawing[name].nominal == pytest.approx(p[k], abs=1e-9), name
        p[k] = specimen.parameters.get(name, p[k])
    x, good = predictor.assemble(p)
    assert good.all()
    names, values, _, _ = predictor.columns(p, x)
    assert tuple(names) == machine.columns
    assert np.abs(values - exact).max() < EXACT


@every_machine
def test_drawing_and_file_state_the_same_tolerances(machine: PortedMachine, tmp_path: Path) -> None:
    (tmp_path / "machine.yaml").write_text(
        machine.machine_text(sigma_factor=2.0, tolerance_factor=3.0), encoding="utf-8"
    )
    drawn = load_machine(tmp_path / "machine.yaml")
    stated = {name: parameter.tolerance for name, parameter in drawn.geometry.items()}
    for name, own in machine.drawing.items():
        assert stated[name] == pytest.approx(3.0 * own.tolerance, rel=1e-9, abs=1e-15), name
    channels = [channel.sigma for sensor in drawn.sensors for channel in sensor.channels]
    assert channels == pytest.approx(2.0 * machine.sigma)


@every_machine
def test_nothing_of_size_zero_changes_anything(machine: PortedMachine) -> None:
    specimen, campaign, exact = measured(machine)
    nothing = tuple(of_kind(machine, kind).scaled(0.0) for kind in machine.kinds())
    assert np.array_equal(machine.measure(specimen, nothing, campaign), exact)


@pytest.mark.parametrize(("machine", "kind"), KINDS, ids=lambda v: v.name)
def test_every_kind_moves_readings_and_grows_from_nothing(machine: PortedMachine, kind: Kind) -> None:
    specimen, campaign, exact = measured(machine)
    # several places: one alone may act where nothing can be seen of it
    some = [of_kind(machine, kind, place) for place in range(0, len(kind.places), 5)]
    whole, one = max(
        ((machine.measure(specimen, (one,), campaign) - exact, one) for one in some),
        key=lambda pair: float(np.max(np.abs(pair[0] / machine.sigma))),
    )
    assert np.max(np.abs(whole / machine.sigma)) > 0.5
    reach = np.max(np.abs(whole))

    def at(factor: float) -> Array:
        return machine.measure(specimen, (one.scaled(factor),), campaign) - exact

    # continuous and nearly in proportion: 10 % of the size stays below 30 % of the effect, 1 % below 5 %
    assert np.max(np.abs(at(0.1))) < 0.3 * reach
    assert np.max(np.abs(at(0.01))) < 0.05 * reach
    assert np.max(np.abs(at(1.001) - whole)) < 0.01 * reach


@every_machine
def test_the_same_seeds_give_the_same_numbers(machine: PortedMachine) -> None:
    first, second = measured(machine), measured(machine)
    assert first[0] == second[0]
    assert np.array_equal(first[2], second[2])
    imperfections = tuple(of_kind(machine, kind) for kind in machine.kinds()[2:6])
    assert imperfections == tuple(of_kind(machine, kind) for kind in machine.kinds()[2:6])
    again = [machine.measure(first[0], imperfections, first[1]) for _ in range(2)]
    assert np.array_equal(again[0], again[1])
    noise = [machine.noisy(first[2], first[1], np.random.default_rng(3)) for _ in range(2)]
    assert np.array_equal(noise[0], noise[1])


@every_machine
def test_noise_is_that_of_the_drawing(machine: PortedMachine) -> None:
    _, campaign, exact = measured(machine, Plan(poses=30))
    noise = machine.noisy(exact, campaign, np.random.default_rng(2), factor=3.0) - exact
    free = campaign.origin != np.arange(len(campaign)) if "dL" in machine.columns else slice(None)
    # 60 rows: a standard deviation is known to 10 %
    assert np.std(noise[free], axis=0) == pytest.approx(3.0 * machine.sigma, rel=0.45)


@every_machine
def test_what_is_not_known_is_refused(machine: PortedMachine) -> None:
    specimen, campaign, _ = measured(machine)
    with pytest.raises(ValueError, match="kind"):
        machine.measure(specimen, (Imperfection("gremlin", ("base",), 1.0),), campaign)
    with pytest.raises(ValueError, match="place"):
        machine.measure(specimen, (Imperfection("mount-drift", ("moon",), 1.0),), campaign)


@every_machine
def test_kinds_are_named_once_and_some_have_no_slug(machine: PortedMachine) -> None:
    kinds = machine.kinds()
    assert len({kind.name for kind in kinds}) == len(kinds)
    assert sum(not kind.in_library for kind in kinds) >= 4
    logged = {f"temperature.{place}" for place in machine.setting.thermometers}
    logged |= {"time", "session", "payload", "pressure", *(f"approach.{name}" for name in machine.readings)}
    assert all(set(kind.needs) <= logged for kind in kinds)


# Mechanics


def test_leg_forces_carry_the_weight_and_do_its_work() -> None:
    machine = Telescope()
    specimen, campaign, _ = measured(machine)
    work = assembled(machine, campaign, specimen)
    forces = telescope_geometry.leg_forces(work, fixed(work, "tool"))
    weight = telescope_geometry.G * (20.0 + campaign.payload)
    assert np.einsum("nk,nk->n", forces, work.solved.along[..., 2]) == pytest.approx(-weight, rel=1e-10)
    step = 1e-4

    def energy(change: float) -> Array:
        other = work.copy()
        other.add("leg2.length", change)
        other.solved = machine.solve(other)
        hub, tool = other.solved.platform, other.solved.platform @ fixed(other, "tool")
        heights = (
            hub[:, 2] @ np.array([*telescope_geometry.MASSES["hub"][1], 1.0]),
            tool[:, 2] @ np.array([*telescope_geometry.MASSES["payload"][1], 1.0]),
        )
        return np.asarray(telescope_geometry.G * (20.0 * heights[0] + campaign.payload * heights[1]))

    work_done = -(energy(step) - energy(-step)) / (2 * step)
    # central differences of energies of 1e5 N mm: rounding leaves 1e-6 N
    assert forces[:, 1] == pytest.approx(work_done, abs=1e-5)


def test_limb_and_wrist_loads_are_those_of_the_energy() -> None:
    machine = Polisher()
    specimen, campaign, _ = measured(machine)
    work = assembled(machine, campaign, specimen)

    def energy(joint: int, change: float) -> Array:
        other = work.copy()
        other.moved[:, joint] += change
        other.solved = machine.solve(other)
        pairs = polisher_physics.weights(other)
        return np.asarray(-sum(np.einsum("ni,ni->n", force, point) for force, point in pairs))

    limbs, torques = polisher_physics.limb_forces(work), polisher_physics.wrist_torques(work)
    for joint, load, step in (
        *((k, limbs[:, k], 1e-3) for k in range(3)),
        *((3 + k, 1e3 * torques[:, k], 1e-6) for k in range(3)),
    ):
        slope = -(energy(joint, step) - energy(joint, -step)) / (2 * step)
        # 4e5 N mm of energy rounded to 1e-16 of itself, over the step
        assert load == pytest.approx(slope, abs=1e-3, rel=1e-6), joint


def test_a_telescope_that_warms_up_as_a_whole_keeps_its_shape() -> None:
    machine = Telescope()
    specimen, campaign, _ = measured(machine)
    still = replace(campaign, q=np.zeros_like(campaign.q))
    free = Specimen({n: 0.0 if n.endswith("offset") else v for n, v in specimen.parameters.items()})
    hot = {place: np.full(len(still), 27.0) for place in still.temperatures}
    still = replace(still, temperatures=hot)
    alpha = 2e-5
    parts = ("base", "platform", *telescope_geometry.LEGS)
    warm = tuple(Imperfection("thermal-expansion", (part,), alpha, {"lag": 0.0}) for part in parts)
    cold, grown = Work(still, {}, np.zeros_like(still.q)), Work(still, {}, np.zeros_like(still.q))
    for work in (cold, grown):
        work.values = {n: np.full(len(still), v) for n, v in free.parameters.items()}
    for part in warm:
        next(p for p in machine.physics if p.kind.name == part.kind).act(grown, part)
    one, two = machine.solve(cold).platform, machine.solve(grown).platform
    assert np.abs(two[:, :3, :3] - one[:, :3, :3]).max() < 1e-10
    assert two[:, :3, 3] == pytest.approx((1 + 7 * alpha) * one[:, :3, 3], abs=1e-8)


def test_two_simulators_of_the_hybrid_agree() -> None:
    robot, workspace = import_module("polisher.robot"), import_module("polisher.workspace")
    machine = Polisher()
    drawn = Specimen({name: own.nominal for name, own in machine.drawing.items()})
    _, campaign, _ = measured(machine)
    seen = machine.measure(drawn, (), campaign).reshape(len(campaign), 3, 3)
    poses = robot.Robot().tool_poses(campaign.q)
    points = np.array(list(workspace.POINTS.values()))
    other = np.einsum("nij,kj->nki", poses[:, :3, :3], points) + poses[:, None, :3, 3]
    # the drawing's base stands at six decimals of the other's
    assert np.abs(seen - other).max() < 1e-6


def test_a_bent_flexure_meets_the_arc_and_its_first_term() -> None:
    angle = np.array([0.0, 0.02, 0.1])
    shift = telescope_physics.beyond_middle(angle)
    assert shift == pytest.approx(telescope_geometry.FLEXURE * angle**2 / 24, rel=2e-3, abs=1e-12)
    # an arc of radius l / w: its ends' tangents meet r tan(w / 2) from either end
    radius = telescope_geometry.FLEXURE / 0.1
    assert shift[2] + telescope_geometry.FLEXURE / 2 == pytest.approx(radius * np.tan(0.05))


def test_backlash_is_the_difference_of_sides_along_the_beam() -> None:
    machine = Nanopositioner()
    specimen, campaign, _ = measured(machine)
    sides = [replace(campaign, approach=np.full_like(campaign.approach, s)) for s in (1.0, -1.0)]
    loose = Imperfection("backlash", ("q2",), 4e-4)

    def path(c: Campaign, found: tuple[Imperfection, ...]) -> Array:
        apart = replace(c, origin=np.zeros(len(c), dtype=np.int64))
        return machine.measure(specimen, found, apart)

    up, down = (path(side, (loose,)) - path(side, ()) for side in sides)
    # a shift along a beam that runs along the slide is seen as it is, the same in every row: no change of length
    assert np.abs(up[1:]).max() < 1e-5
    mixed = replace(
        campaign, approach=np.where(np.arange(len(campaign))[:, None] % 2, 1.0, -1.0) * np.ones((1, 6))
    )
    seen = path(mixed, (loose,)) - path(mixed, ())
    assert np.abs(np.abs(seen[1::2]) - 4e-4).max() < 1e-5
    assert np.abs(down[1:]).max() < 1e-5


def test_the_mirrors_spot_lies_on_the_light() -> None:
    machine = Nanopositioner()
    specimen, campaign, _ = measured(machine)
    work = assembled(machine, campaign, specimen)
    optics = work.solved
    assert isinstance(optics, nanopositioner_physics.Optics)
    assert isinstance(optics.constants, Constants)
    length = machine.see(work)[:, 0]
    spot = np.column_stack([optics.spot(length), np.zeros(len(length)), np.ones(len(length))])
    world = np.einsum("nij,nj->ni", optics.mirror, spot)[:, :3]
    beam = np.array([specimen.parameters[f"beam.{axis}"] for axis in "xyz"])
    assert np.linalg.norm(world - beam, axis=1) == pytest.approx(length, abs=1e-9)


def test_weight_bends_the_ring_in_proportion_to_it() -> None:
    machine = Telescope()
    specimen, campaign, exact = measured(machine)
    kind = next(k for k in machine.kinds() if k.name == "platform-bends-by-weight")
    bent = [
        machine.measure(
            specimen, (of_kind(machine, kind),), replace(campaign, payload=np.full(len(campaign), kg))
        )
        - exact
        for kg in (0.0, 5.0, 10.0)
    ]
    # 5 kg more each time; the loads of a bent platform differ by its strain, about 1e-3
    assert np.abs((bent[2] - bent[1]) - (bent[1] - bent[0])).max() < 1e-2 * np.abs(bent[2] - bent[1]).max()
