"""Laws of planned measurement poses: exact gradients, no step back, poses that a machine can take."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner, Result

from truepose.cli import app
from truepose.errors import InputError
from truepose.identification.decomposition import Decomposition
from truepose.identification.load import load_recording
from truepose.identification.planning.continuous import Landscape, climb
from truepose.identification.planning.criteria import CRITERIA, Objective
from truepose.identification.planning.exchange import Pool, exchange
from truepose.identification.planning.information import PoseInformation
from truepose.identification.planning.plan import plan
from truepose.identification.planning.table import plan_table
from truepose.identification.prediction import Predictor
from truepose.identification.problem import prior_of
from truepose.identification.simulate import parse_effect, simulate, with_inputs
from truepose.models.load import load_machine
from truepose.models.machine import Machine, Mass
from truepose.models.sensors.pose import Position

Array = NDArray[np.float64]
MACHINES = Path(__file__).parent / "machines"
NAMES = ("serial", "pus", "ups", "distance")
RULER = """
schema: truepose/machine/1
name: ruler
mechanism:
  type: serial
  joints:
    - {name: q1, kind: prismatic, range: [-40, 100]}
sensor: {type: position, sigma: {xyz: 0.01}}
tolerances: {length: 0, angle: 0, q1.r: 0.5}
effects:
  - {effect: actuator-scale, place: [q1], parameters: {s: 0}}
"""


def machine_of(name: str) -> Machine:
    return load_machine(MACHINES / f"{name}.yaml")


def written(folder: Path, text: str) -> Path:
    (folder / "machine.yaml").write_text(text, encoding="utf-8")
    return folder / "machine.yaml"


def loaded(name: str) -> Machine:
    """Machines with effects as well: loads in an open and in a closed chain."""
    if not name.endswith(" with effects"):
        return machine_of(name)
    machine = machine_of(name.removesuffix(" with effects"))
    texts = ["joint-compliance@q2:c=1e-7", "transmission-error@q3:a=1e-4,b=0,order=1", "gravity-sag@tool"]
    if name.startswith("pus"):
        mass = Mass("mirror", 20.0, (10.0, 5.0, 30.0), machine.mechanism.flange)
        machine = replace(machine, gravity=(0.0, 0.0, -9.80665), masses=(mass,))
        texts = ["actuator-scale@rho2:s=1e-3", "leg-compliance@leg2:c=1e-4"]
    return machine.with_effects(tuple(parse_effect(text, machine) for text in texts))


def poses(information: PoseInformation, n: int, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    return rng.uniform(information.low, information.high, (n, len(information.low)))


def landscape(machine: Machine, criterion: str) -> Landscape:
    """The criterion as ``plan`` judges it, on the directions that 60 random poses see."""
    information = PoseInformation(machine)
    k = len(information.names)
    if CRITERIA[criterion].with_prior:
        return Landscape(information, Objective(CRITERIA[criterion], np.eye(k), np.diag(information.weight)))
    rows = information.rows(information.at(poses(information, 60, 9)).signature).reshape(-1, k)
    w, v = np.linalg.eigh(rows.T @ rows / 60)
    basis = v[:, w > 1.0]
    return Landscape(information, Objective(CRITERIA[criterion], basis, np.zeros((basis.shape[1],) * 2)))


GRADIENTS = (
    *product((*NAMES, "serial with effects", "pus with effects"), ("d", "a", "o5")),
    ("hybrid", "d"),
    ("delta", "o5"),
)


@pytest.mark.parametrize(("name", "criterion"), GRADIENTS)
def test_gradients_are_exact_through_loops_loads_and_differences_of_rows(name: str, criterion: str) -> None:
    """Against differences of eighth order along random directions of all joints of all poses."""
    function = landscape(loaded(name), criterion)
    information = function.information
    q = 0.8 * poses(information, 12) + 0.2 * information.home
    value, gradient = function.gradient(information.at(q))
    assert value == function.value(information.at(q))
    rng = np.random.default_rng(4)
    for _ in range(3):
        e = 5e-3 * (information.high - information.low) * rng.uniform(-1, 1, q.shape)
        both = [[function.value(information.at(q + sign * k * e)) for sign in (1, -1)] for k in (1, 2, 3, 4)]
        difference = sum(
            c * (up - down) for c, (up, down) in zip((4 / 5, -1 / 5, 4 / 105, -1 / 280), both, strict=True)
        )
        # values have some 13 digits, more than six of which remain of a change by 5e-3 of the ranges
        assert abs(difference - float(np.sum(gradient * e))) < 1e-5 * float(np.linalg.norm(gradient * e))


@pytest.mark.parametrize("name", [*NAMES, "serial with effects"])
def test_the_planned_information_is_what_a_fit_would_use(name: str, tmp_path: Path) -> None:
    """Against the Jacobian of the fit's residuals on a recording at these poses."""
    machine = loaded(name)
    information = PoseInformation(machine)
    found = information.at(poses(information, 8))
    rows = information.rows(found.signature).reshape(-1, len(information.names))
    made = plan(machine, 8, method="random")
    made = replace(made, q=found.q)
    plan_table(made).to_csv(tmp_path / "poses.csv", index=False)
    frame = simulate(
        machine, load_recording(machine, [tmp_path / "poses.csv"], need_readings=False), seed=None
    )
    with_inputs(tmp_path / "poses.csv", frame).to_csv(tmp_path / "recording.csv", index=False)
    predictor = Predictor(machine, load_recording(machine, [tmp_path / "recording.csv"]), machine.effects)
    p = predictor.model.p_home
    prior = prior_of(machine, machine.effects)
    x, _ = predictor.assemble(p)
    fitted = np.concatenate([block.jacobian for block in predictor.blocks(p, x)])
    fitted = (fitted[..., prior.free] * prior.scale[prior.free]).reshape(-1, len(prior.free))
    gram = fitted.T @ fitted
    # the recording's joints are rounded to 1e-12 of their range
    assert np.max(np.abs(rows.T @ rows - gram)) < 1e-9 * np.max(gram)


@dataclass(frozen=True)
class OwnResidual(Position):
    """A position sensor whose residual is its own, turned into the tool's axes."""

    type = "own-residual"

    def residual(self, world: ca.SX, s: Mapping[str, ca.SX], reading: ca.SX) -> ca.SX:
        return world[:3, :3].T @ (world[:3, 3] - reading)


def test_a_sensor_with_a_residual_of_its_own_is_planned_for_all_the_same() -> None:
    machine = machine_of("serial")
    own = replace(machine, sensors=(OwnResidual(0.01),))
    plain, turned = landscape(machine, "d"), landscape(own, "d")
    q = poses(plain.information, 9)
    value, gradient = plain.gradient(plain.information.at(q))
    other, slope = turned.gradient(turned.information.at(q))
    assert other == pytest.approx(value, rel=1e-12)
    assert slope == pytest.approx(gradient, rel=1e-9, abs=1e-9 * float(np.max(np.abs(gradient))))


@dataclass(frozen=True)
class Grouped(Position):
    """A position sensor whose readings mean something only in groups of rows."""

    type = "grouped"
    label_columns = ("group",)


def test_sensors_that_group_rows_are_refused() -> None:
    machine = machine_of("serial")
    with pytest.raises(InputError, match="'grouped': its readings depend on how several rows are grouped"):
        plan(replace(machine, sensors=(Grouped(0.01),)), 5)


def test_information_too_small_for_a_criterion_is_refused() -> None:
    with pytest.raises(InputError, match="leave some constants open"):
        plan(machine_of("serial"), 5, criterion="o4", method="exchange")


@pytest.mark.parametrize("name", CRITERIA)
def test_criteria_have_exact_slopes(name: str) -> None:
    """d = 2 <J slope, dJ>, against central differences."""
    rng = np.random.default_rng(1)
    rows, change = rng.normal(size=(2, 1, 9, 5)) * [[[[1.0]]], [[[1e-4]]]]
    objective = Objective(CRITERIA[name], np.eye(5), np.eye(5))
    difference = (objective.value(rows + change) - objective.value(rows - change)) / 2
    # steps of 1e-4 leave eight digits of slopes of order one
    assert 2 * float(np.sum((rows @ objective.slope(rows)) * change)) == pytest.approx(difference, rel=1e-5)


def test_observability_criteria_are_logarithms_of_the_indices() -> None:
    rng = np.random.default_rng(2)
    a = rng.normal(size=(12, 6)) * np.array([1, 2, 3, 4, 5, 30])
    indices = Decomposition.of(a, np.zeros(6)).observability(12)
    value = {
        name: Objective(CRITERIA[name], np.eye(6), np.zeros((6, 6))).value(a[None])
        for name in ("o1", "o2", "o3", "o4", "o5")
    }
    assert np.exp(value["o1"] / 12) / np.sqrt(12) == pytest.approx(indices.o1, rel=1e-9)
    for name in ("o2", "o3", "o4", "o5"):
        assert np.exp(value[name]) == pytest.approx(getattr(indices, name), rel=1e-9)


@pytest.mark.parametrize("criterion", ["d", "a", "o1"])
@pytest.mark.parametrize("name", ["serial", "distance"])
def test_exchange_ends_where_no_pose_added_and_another_eliminated_gains(name: str, criterion: str) -> None:
    """Against decompositions of the whole information for every candidate; never below its start."""
    function = landscape(machine_of(name), criterion)
    information, objective = function.information, function.objective
    signature = information.at(poses(information, 60)).signature
    start = list(range(14))

    def value(design: list[int]) -> float:
        rows = objective.project(information.rows(signature[design]))
        return objective.value(rows)

    pool = Pool.of(objective.project(signature), information.differs)
    found = exchange(pool, objective, start)
    assert len(found) == len(start) and value(found) > value(start)
    added = max(([*found, c] for c in range(60) if c not in found), key=value)
    swapped = max((added[:k] + added[k + 1 :] for k in range(len(added))), key=value)
    assert value(swapped) <= value(found) + 2e-6 * abs(value(found))


@pytest.mark.parametrize(
    ("name", "criterion"),
    [*(("serial", c) for c in CRITERIA), ("pus", "d"), ("ups", "o1"), ("distance", "o5")],
)
def test_each_step_of_a_plan_is_no_worse_than_the_one_before(name: str, criterion: str) -> None:
    machine = machine_of(name)
    found = plan(machine, 14, criterion=criterion)
    assert found.by_exchange is not None
    assert found.by_exchange >= np.max(found.random)
    # joints are rounded to 1e-6 of their range after the last step
    assert found.value >= found.by_exchange - 1e-6 * abs(found.by_exchange)
    if criterion == "d":
        assert found.shrinkage is not None and found.shrinkage < 0.9


def test_continuous_poses_are_stationary_inside_the_ranges() -> None:
    """No pose can be moved, as far as its ranges allow, with a gain worth the optimiser's time."""
    function = landscape(machine_of("serial"), "d")
    information = function.information
    q = climb(function, poses(information, 10))
    _, gradient = function.gradient(information.at(q))
    span = information.high - information.low
    inward = np.where(
        q <= information.low,
        np.maximum(gradient, 0),
        np.where(q >= information.high, np.minimum(gradient, 0), gradient),
    )
    start = function.gradient(information.at(poses(information, 10)))[1]
    assert np.max(np.abs(inward * span)) < 1e-3 * np.max(np.abs(start * span))


def test_a_ruler_is_calibrated_at_its_ends(tmp_path: Path) -> None:
    """A straight line, offset and scale: half of the poses at either end, as is well known."""
    found = plan(load_machine(written(tmp_path, RULER)), 6)
    assert sorted(found.q[:, 0]) == [-40.0] * 3 + [100.0] * 3
    # log det of the line's information, one reading of three (x and y see nothing), priors of r and s
    design = np.column_stack([np.full(6, 0.5), [-40, -40, -40, 100, 100, 100]]) / 0.01
    scale = prior_of(found.machine, found.machine.effects)
    design[:, 1] *= scale.scale[scale.free][1]
    weight = (scale.scale / np.where(scale.sigma > 0, scale.sigma, 1.0))[scale.free]
    assert found.value == pytest.approx(
        np.linalg.slogdet(design.T @ design + np.diag(weight**2))[1], rel=1e-9
    )


@pytest.mark.parametrize("method", ["continuous", "exchange", "random"])
@pytest.mark.parametrize("name", NAMES)
def test_plans_are_reproducible_and_can_be_measured(name: str, method: str, tmp_path: Path) -> None:
    """The same from the same seed, inside the ranges, and a recording of them can be simulated."""
    machine = machine_of(name)
    found, again, other = (plan(machine, 10, method=method, seed=seed) for seed in (3, 3, 4))
    assert found.q.tobytes() == again.q.tobytes() and found.value == again.value
    assert not np.array_equal(found.q, other.q)
    ranges = np.array([actuator.range for actuator in machine.mechanism.actuators], dtype=float)
    assert (found.q >= ranges[:, 0]).all() and (found.q <= ranges[:, 1]).all()
    table = plan_table(found)
    table.to_csv(tmp_path / "poses.csv", index=False)
    recording = load_recording(machine, [tmp_path / "poses.csv"], need_readings=False)
    assert np.max(np.abs(recording.q - found.q) / (ranges[:, 1] - ranges[:, 0])) < 1e-11
    assert len(simulate(machine, recording)) == 10
    assert ("from" in table) == (name == "distance")


def test_changes_count_from_the_pose_before(tmp_path: Path) -> None:
    table = plan_table(plan(machine_of("distance"), 6))
    assert table["pose"].to_list() == [1, 2, 3, 4, 5, 6]
    assert table["from"].to_list() == [1, 1, 2, 3, 4, 5]


def test_repeats_share_a_pose_number(tmp_path: Path) -> None:
    found = plan(load_machine(written(tmp_path, RULER)), 4)
    table = plan_table(found)
    assert table["pose"].nunique() == 2 and found.repeats(0.01) == 2
    assert table.groupby("pose")["q1"].nunique().max() == 1


def test_directions_that_nothing_sees_do_not_matter() -> None:
    """A frame turned and moved with what follows it: fewer directions are determined than there are constants."""
    found = plan(machine_of("serial"), 12, method="exchange")
    assert np.isfinite(found.value) and np.isfinite(found.random).all()
    assert 0 < found.determined < len(PoseInformation(found.machine).names)


def test_poses_that_cannot_be_assembled_are_never_planned(tmp_path: Path) -> None:
    """Legs that reach far beyond what the loops allow."""
    text = (MACHINES / "ups.yaml").read_text().replace("range: [-8, 8]", "range: [-40, 40]")
    machine = load_machine(written(tmp_path, text))
    information = PoseInformation(machine)
    assert not information.at(poses(information, 200)).good.all()
    found = plan(machine, 8)
    assert information.at(found.q).good.all() and np.isfinite(found.value)


def test_candidates_stay_where_they_are() -> None:
    machine = machine_of("serial")
    information = PoseInformation(machine)
    given = poses(information, 40)
    found = plan(machine, 8, method="exchange", candidates=given)
    assert all((row == given).all(axis=1).any() for row in found.q)
    assert len(np.unique(found.q, axis=0)) == 8
    assert found.value >= np.max(found.random)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (RULER.replace(", range: [-40, 100]", ""), "joint 'q1': found no range"),
        (RULER.replace(", q1.r: 0.5", "").split("effects:", maxsplit=1)[0], "nothing to calibrate"),
    ],
)
def test_machines_without_ranges_or_unknowns_are_refused(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        plan(load_machine(written(tmp_path, text)), 5)
    assert says in str(error.value)


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_the_command_writes_poses_and_says_what_they_are_worth(tmp_path: Path) -> None:
    output = tmp_path / "poses.csv"
    result = run("plan", MACHINES / "distance.yaml", "-n", 7, "-o", output, "--seed", 2)
    assert result.exit_code == 0, result.output
    head, comment, *_ = output.read_text().splitlines()
    assert head == "# poses of stage for calibration: 7, continuous, seed 2"
    assert "log det(J'J + prior) = " in comment and "random poses" in comment
    assert "random poses" in result.stdout
    machine = machine_of("distance")
    recording = load_recording(machine, [output], need_readings=False)
    assert np.array_equal(recording.q, plan(machine, 7, seed=2).q) and recording.from_row is not None
    assert run("simulate", MACHINES / "distance.yaml", output, "-o", tmp_path / "out.csv").exit_code == 0


def test_the_command_s_json_is_one_object(tmp_path: Path) -> None:
    output = tmp_path / "poses.parquet"
    result = run("plan", MACHINES / "serial.yaml", "-n", 6, "-o", output, "--method", "exchange", "--json")
    document = json.loads(result.stdout)
    assert document["command"] == "plan" and document["poses"] == 6
    # joints are rounded after the exchange
    assert (
        document["value"] == pytest.approx(document["exchange"], rel=1e-6)
        and document["random"]["mean"] < document["value"]
    )
    recording = load_recording(machine_of("serial"), [output], need_readings=False)
    assert len(recording) == 6


def test_candidates_are_read_from_a_file_and_drivers_that_are_not_planned_are_named(tmp_path: Path) -> None:
    text = (MACHINES / "serial.yaml").read_text()
    text += "effects:\n  - {effect: backlash, place: [q2], parameters: {b: {value: 0.01, unit: deg}}}\n"
    machine = written(tmp_path, text)
    candidates, output = tmp_path / "candidates.csv", tmp_path / "poses.csv"
    assert run("plan", machine, "-n", 20, "-o", candidates, "--method", "random").exit_code == 0
    result = run("plan", machine, "-n", 5, "-o", output, "--candidates", candidates)
    assert result.exit_code == 0, result.output
    assert "'approach.q2' is not planned" in result.stderr
    rows, known = (
        {line.split(",", 1)[1] for line in file.read_text().splitlines() if line[0].isdigit()}
        for file in (output, candidates)
    )
    assert len(rows) == 5 and rows <= known


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["-n", 5, "--method", "best"], "found 'best', expected one of continuous, exchange, random"),
        (["-n", 5, "--criterion", "e"], "found 'e', expected one of d, a, o1"),
        (["-n", 3, "--criterion", "o1"], "expected at least 13 readings"),
        (["-n", 5, "--candidates", "missing.csv"], "cannot read the file"),
        (["-n", 5, "--candidates", MACHINES / "serial.yaml"], "found"),
    ],
)
def test_bad_requests_are_one_line_and_leave_the_file_as_it_was(
    arguments: list[object], says: str, tmp_path: Path
) -> None:
    output = tmp_path / "poses.csv"
    output.write_text("old", encoding="utf-8")
    result = run("plan", MACHINES / "serial.yaml", "-o", output, *arguments)
    assert result.exit_code == 2 and result.stdout == ""
    assert says in result.stderr and len(result.stderr.strip().splitlines()) == 1
    assert output.read_text() == "old"


def test_candidates_cannot_be_moved(tmp_path: Path) -> None:
    candidates = tmp_path / "candidates.csv"
    assert (
        run("plan", MACHINES / "serial.yaml", "-n", 9, "-o", candidates, "--method", "random").exit_code == 0
    )
    result = run(
        "plan",
        MACHINES / "serial.yaml",
        "-n",
        5,
        "-o",
        tmp_path / "p.csv",
        "--candidates",
        candidates,
        "--method",
        "continuous",
    )
    assert result.exit_code == 2 and "candidates stay in place" in result.stderr
    assert run("plan", MACHINES / "serial.yaml", "-n", 1, "-o", tmp_path / "p.csv").exit_code == 2
