"""Laws of the simultaneous form: columns of about one length, last steps within bounds, ends told for what they are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.typing import NDArray

from support.built_machines import FRAMES, manufactured, nominal
from support.moving_machines import record, written
from support.solvers import ARM, MADE, hexapod, read_machines, simulated
from truepose.identification.fit.leastsquares import Status
from truepose.identification.fit.problem import Problem, prior_of
from truepose.identification.leaves.ipopt.solving import REST, Program, polished, sparsity_of
from truepose.identification.prediction.predictor import Predictor
from truepose.models.machine.home import coordinate_scale
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.mktemp("machines"))


def program_of(machine: Machine, n: int = 5, weights: Array | None = None) -> Program:
    rng = np.random.default_rng(3)
    recording = simulated(machine, manufactured(machine, rng), rng, n=n)
    prior = prior_of(machine)
    problem = Problem(Predictor(machine, recording), prior, nominal(machine), ~recording.validation)
    problem.weights = np.ones(n) if weights is None else weights
    return Program(problem, np.zeros(len(prior.free)))


@pytest.mark.parametrize("name", ["6-pus", "delta", "hybrid"])
def test_columns_and_equations_are_of_about_one_length(machines: Mapping[str, Machine], name: str) -> None:
    """A coordinate's unit shows as one sigma a row, or is a thousandth of its natural size where that shows less."""
    program = program_of(machines[name])
    problem, rows = program.problem, int(program.problem.used.sum())
    start = program.unknowns(np.zeros(program.n))
    model = problem.predictor.model
    natural = coordinate_scale(machines[name], program.nx, model.gap.numel()).size
    ones = np.append(start[: program.n], np.ones(program.size - program.n))
    unit = program.coordinates(ones)[0] - program.coordinates(start)[0]
    shows = program.observations(start)[1].toarray()[:, program.n :].reshape(-1, rows, program.nx)
    seen = np.sqrt(np.sum(shows**2, axis=(0, 1)) / rows)
    largest = REST * natural
    assert np.all(unit > 0.0) and np.all(unit <= largest * (1.0 + 1e-9))
    short = unit < largest * (1.0 - 1e-9)
    np.testing.assert_allclose(seen[short], 1.0, rtol=1e-9)
    assert np.all(seen[~short] <= 1.0 + 1e-9)
    loops = program.equations(start)[1].toarray()[: rows * program.nx]
    length = np.linalg.norm(loops, axis=1).reshape(rows, program.nx)
    np.testing.assert_allclose(np.median(length, axis=0), 1.0, rtol=1e-9)
    assert np.all(program.steps(start) == 0.0)


def test_weights_of_rows_count_as_their_roots(machines: Mapping[str, Machine]) -> None:
    """Residuals, and their derivatives by parameters and coordinates, of a row that counts a quarter are half as large."""
    weights = np.array([1.0, 0.25, 1.0, 1.0, 0.25])
    found = []
    for program in (program_of(machines["delta"]), program_of(machines["delta"], weights=weights)):
        start = program.unknowns(np.zeros(program.n))
        value, slopes = program.observations(start)
        units = np.append(start[: program.n], np.ones(program.size - program.n))
        unit = (program.coordinates(units) - program.coordinates(start)).ravel()
        found.append((value, slopes.toarray() / np.append(program.step, unit)))
    root = np.repeat(np.sqrt(weights), len(found[0][0]) // 5)
    np.testing.assert_allclose(found[1][0], found[0][0] * root, rtol=1e-9)
    np.testing.assert_allclose(found[1][1], found[0][1] * root[:, None], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("mechanism", "middle"),
    [(hexapod("6-ups", "range: [480, 560]"), [500.0] * 6), (ARM, [0.0, 0.2, -0.1, 0.3])],
    ids=["looped", "chain"],
)
def test_derivatives_of_readings_that_compare_rows(
    tmp_path: Path, mechanism: str, middle: Sequence[float]
) -> None:
    """By coordinates of this row and of the row it counts from, with weights and a row that is not fitted."""
    sensor = (
        "sensor: [{type: position, sigma: {xyz: 0.05}}, {type: distance, sigma: {distance: 0.001}, "
        "beam: {xyz: [0, 0, 900]}, mirror: {in: tool, z: 2, rx: 3, ry: -4}}]\n"
    )
    machine = written(tmp_path, MADE + FRAMES + mechanism + sensor)
    rng, n = np.random.default_rng(12), 4
    way = np.array([15.0 if a.unit == "mm" else 0.3 for a in machine.mechanism.actuators])
    q = np.array(middle) + way * rng.uniform(-1, 1, (n, len(way)))
    poses = replace(record(machine, q), from_row=np.array([0, 0, 1, 1]))
    predictor = Predictor(machine, poses)
    names, values, _, _ = predictor.columns(
        manufactured(machine, rng), predictor.assemble(nominal(machine))[0]
    )
    recording = replace(poses, observations=dict(zip(names, values.T, strict=True)))
    used = np.array([True, False, True, True])
    problem = Problem(Predictor(machine, recording), prior_of(machine), nominal(machine), used)
    problem.weights = np.array([1.0, 1.0, 0.25, 1.0])
    program = Program(problem, np.zeros(len(problem.prior.free)))
    v = 1e-2 * rng.standard_normal(program.size)
    value, slopes = program.observations(v)
    assert value.shape == (3 * 4,) and slopes.shape == (12, program.size)
    for _ in range(4):
        way = rng.standard_normal(program.size)
        ends = [program.observations(v + sign * 1e-4 * way)[0] for sign in (-1, 1)]
        slope = slopes @ way
        np.testing.assert_allclose((ends[1] - ends[0]) / 2e-4, slope, atol=1e-6 * np.max(np.abs(slope)))


@pytest.mark.parametrize("name", ["6-pus", "delta"])
def test_a_row_knows_its_own_coordinates_alone(machines: Mapping[str, Machine], name: str) -> None:
    """So that the work of a fit grows with the rows: of readings and of loops, and what is stored of them."""
    program = program_of(machines[name])
    start = program.unknowns(np.zeros(program.n))
    rows = program.problem.used.sum()
    for slopes in (program.observations(start)[1], program.equations(start)[1][: rows * program.nx].tocsc()):
        at, column = slopes.tocoo().coords
        own = column >= program.n
        each = slopes.shape[0] // rows
        np.testing.assert_array_equal(at[own] // each, (column[own] - program.n) // program.nx)
        assert slopes.nnz == slopes.shape[0] * (program.n + program.nx)


def test_a_pattern_lists_its_entries_in_order() -> None:
    matrix = sp.csc_array((np.ones(5), np.array([2, 0, 1, 2, 0]), np.array([0, 2, 3, 5])), shape=(3, 3))
    expected = matrix.toarray() != 0.0
    pattern = sparsity_of(matrix)
    found = np.zeros((3, 3), dtype=bool)
    found[pattern.row(), pattern.get_col()] = True
    np.testing.assert_array_equal(found, expected)
    assert pattern.nnz() == 5


# -- the end ---------------------------------------------------------------------------------------------


class Bowl:
    """Readings of two steps: least at ``lowest``, and slightly bent."""

    def __init__(self, lowest: Array, bend: float = 0.0, evaluations: int = 99) -> None:
        self._lowest, self._bend, self._left = lowest, bend, evaluations

    def blocks(self, t: Array) -> Iterator[Array]:
        self._left -= 1
        off = t - self._lowest
        slopes = np.array([[2.0, 0.0], [0.5, 1.0]]) + np.diag(2.0 * self._bend * off)
        rows = np.column_stack([slopes, [2.0 * off[0], 0.5 * off[0] + off[1]] + self._bend * off**2])
        yield np.vstack([rows, [0.0, 0.0, 3.0]]) if self._left >= 0 else np.full((3, 3), np.nan)


WIDE = (np.full(2, -9.0), np.full(2, 9.0))


def ended(
    bowl: Bowl, t: Array, bounds: tuple[Array, Array] = WIDE, status: Status = Status.STALLED
) -> tuple[Array, Status]:
    found = polished(cast(Problem, bowl), t, bounds, status, 7)
    assert found.iterations == 7
    return found.t, found.status


def test_last_steps_lead_to_the_minimum_but_never_beyond_a_bound() -> None:
    lowest = np.array([1.0, -2.0])
    near = lowest + np.array([3e-5, -2e-5])
    found, status = ended(Bowl(lowest, bend=0.3), near)
    np.testing.assert_allclose(found, lowest, atol=1e-12)
    assert status is Status.CONVERGED
    for k in (0, 1):
        for side in (-1.0, 1.0):
            # what is inside, so near to a bound that the step to the minimum would cross it in one coordinate alone
            t, bounds = lowest.copy(), [b.copy() for b in WIDE]
            t[k] += -side * 3e-5
            bounds[0 if side < 0 else 1][k] = lowest[k] - side * 1e-5
            found, _ = ended(Bowl(lowest), t, (bounds[0], bounds[1]))
            assert np.all(found >= bounds[0]) and np.all(found <= bounds[1])


def test_an_end_is_a_minimum_where_nothing_is_left_and_bounds_hold_what_pushes_out() -> None:
    lowest = np.array([1.0, -2.0])
    low, high = np.array([1.5, -9.0]), np.array([9.0, 9.0])
    held = np.array([1.5, -2.25])  # least of the second where the first stands at 1.5
    found, status = ended(Bowl(lowest), held, (low, high))
    np.testing.assert_allclose(found, held)
    assert status is Status.CONVERGED
    # on the wrong side of a bound the readings pull inwards: no minimum
    wrong = np.array([0.5, -1.75])
    assert ended(Bowl(lowest), wrong, (np.array([0.5, -9.0]), high))[1] is Status.STALLED
    assert ended(Bowl(lowest), wrong, (WIDE[0], np.array([0.5, 9.0])))[1] is Status.CONVERGED
    assert ended(Bowl(lowest), held, (WIDE[0], np.array([1.5, 9.0])))[1] is Status.STALLED
    # far from rest nothing is changed, and a limit stays a limit
    far = lowest + 0.5
    found, status = ended(Bowl(lowest), far)
    np.testing.assert_array_equal(found, far)
    assert status is Status.STALLED
    assert ended(Bowl(lowest), lowest, status=Status.LIMIT)[1] is Status.LIMIT
    assert ended(Bowl(lowest, evaluations=0), lowest)[1] is Status.FAILED


def test_what_is_left_to_gain_is_told() -> None:
    """Half the sum of squares here less that at the minimum, of a problem without bend; and the step that gains it."""
    lowest, t = np.array([1.0, -2.0]), np.array([1.4, -2.3])
    found = polished(cast(Problem, Bowl(lowest)), t, WIDE, Status.STALLED, 1)
    assert found.cost == pytest.approx(0.5 * (0.8**2 + 0.1**2 + 9.0))
    assert found.decrement == pytest.approx(found.cost - 4.5)
    np.testing.assert_allclose(found.movement, lowest - t)
