"""Laws of cases on every simulated machine: what a size means, many effects at once, drawings that are wrong."""

from __future__ import annotations

import ast
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import challenge as package
from challenge import schedule
from challenge.adaptation import Adaptation
from challenge.cases import draw_case
from challenge.measures import difference
from challenge.nulls import gone_wild, misstated, noisy, wild_rows
from challenge.real_like import FEWEST, MOST, NO_FAMILY, real_like
from challenge.setup import Setup, Setups
from challenge.simulator.arm import Arm
from challenge.simulator.base import Imperfection, Kind, Plan
from challenge.simulator.registry import MACHINES
from challenge.slopes import Constant, by_joints
from challenge.strata import nameable
from proof_support.tiny_machine import Tiny
from support.examples import NIGHT
from truepose.errors import ConvergenceError
from truepose.identification.prediction.predictor import Predictor
from truepose.models.load import load_machine

Array = NDArray[np.float64]
every_machine = pytest.mark.parametrize("name", list(MACHINES))


def _source(module: str) -> Path:
    """Where a module of the examination would be."""
    return Path(str(package.__file__)).parents[1] / f"{module.replace('.', '/')}.py"


def _setup(name: str, *, moving: bool = False) -> Setup:
    machine, rng = MACHINES[name](), np.random.default_rng(4)
    return Setup.draw(machine, machine.specimen(rng), Plan(sessions=2, moving=moving), rng)


@every_machine
def test_the_simulators_derivatives_are_those_of_the_drawing(name: str) -> None:
    """Two programs, one derivative: differences of exact readings against the product's exact Jacobian at the truth.

    Differences are good to (step / radius)^2 of curvature, 1e-5 at most, and 1e-11 mm / step of rounding.
    """
    setup = _setup(name)
    predictor = Predictor(*setup.read)
    names, home = predictor.model.names, predictor.model.p_home
    own = np.array([setup.specimen.parameters.get(n, p) for n, p in zip(names, home, strict=True)])
    blocks = list(predictor.blocks(own, predictor.assemble(own)[0]))
    exact = np.concatenate([b.jacobian for b in blocks])[~setup.campaign.validation]
    at = [names.index(c.name) for c in setup.free]
    wanted = exact.reshape(-1, exact.shape[-1])[:, at] * np.array([c.step for c in setup.free])
    found = setup.bench.jacobian
    assert found.shape == wanted.shape
    scale = np.maximum(np.abs(wanted).max(axis=0), 1e-3)
    assert np.max(np.abs(found - wanted) / scale) < 1e-4


def test_what_a_size_means_does_not_ask_the_product() -> None:
    """Detection limits import nothing of the identification, however far one follows their imports."""
    seen, todo = set[str](), [f"challenge.{name}" for name in ("sizing", "adaptation", "slopes")]
    while todo:
        module = todo.pop()
        seen.add(module)
        for node in ast.walk(ast.parse(_source(module).read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                used = {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
                assert not any(name.startswith("truepose.identification") for name in used), (
                    f"{module}: {used}"
                )
                todo += sorted(name for name in used - seen if _source(name).is_file())
    assert {"challenge.measures", "challenge.solutions"} <= seen


@every_machine
def test_physics_superposes(name: str) -> None:
    """All kinds at once, each as large as the noise: together they do the sum of what each does alone.

    What is left are products of two small things, below 1e-3. Only the error of a fringe is left out: it follows the length
    that is truly there, and so takes another phase when anything moves the mirror by a share of a wavelength.
    """
    setup, rng = _setup(name, moving=True), np.random.default_rng(8)
    things = [
        Imperfection(kind.name, place, kind.typical, dict(setup.machine.shape(kind.name, place, rng)))
        for kind in nameable(setup.machine.kinds())
        for place in kind.places[:2]
        if kind.slug != "sensor-periodic"
    ]
    sizes = [float(np.linalg.norm(setup.change(thing))) for thing in things]
    small = [t.scaled(1.0 / size) for t, size in zip(things, sizes, strict=True)]
    alone = np.array([setup.change(thing) for thing in small])
    assert len(things) >= 15 and np.linalg.norm(alone, axis=1).min() > 0.5  # some grow faster than their size
    together = setup.bench.change(setup.exact(small)[0])
    assert np.linalg.norm(together - alone.sum(axis=0)) < 1e-3


@every_machine
def test_a_real_like_machine_has_families_and_singles_of_many_sizes(name: str) -> None:
    machine = MACHINES[name]()
    counts, factors, families = [], [], Counter[str]()
    slow = name in ("polisher", "telescope")  # their derivatives take long
    for seed in range(2 if slow and not NIGHT else 4):
        rng = np.random.default_rng([seed, 5])
        found = real_like(Setups(machine, machine.specimen(rng), seed, sessions=2), rng)
        names = [(k.slug, p.imperfection.place) for k, p in zip(found.kinds, found.parts, strict=True)]
        assert len(set(names)) == len(names) and all(slug for slug, _ in names)
        counts.append(len(names))
        factors += [part.factor for part in found.parts]
        for kind in {k.name: k for k in found.kinds}.values():
            own = [f for f, k in zip(found.families, found.kinds, strict=True) if k == kind and f]
            if own:
                assert kind.slug not in NO_FAMILY and set(own) == {kind.name}
                families[kind.name] += 1
                sizes = {
                    p.imperfection.size for p, f in zip(found.parts, found.families, strict=True) if f in own
                }
                assert len(sizes) == len(own)  # no two members alike
    assert min(counts) >= FEWEST and max(counts) <= MOST
    assert families and max(factors) > 15.0 and min(factors) < 5.0


@pytest.mark.parametrize("stratum", ["single", "two", "out-of-library", "real-like", "null"])
def test_a_wrong_drawing_is_in_the_key_and_in_the_file(stratum: str, tmp_path: Path) -> None:
    case = draw_case(Tiny(), schedule.Seat(7, stratum, schedule.MISSTATED, "tiny"), 3)
    key = case.solution
    assert 1 / 1.5 <= key.noise <= 1.5 and key.noise != 1.0
    assert 0.5 <= key.tolerance_scale <= 2.0 and key.tolerance_scale != 1.0
    (tmp_path / "said.yaml").write_text(case.machine)
    (tmp_path / "true.yaml").write_text(Tiny().machine_text())
    said, true = load_machine(tmp_path / "said.yaml"), load_machine(tmp_path / "true.yaml")
    assert true.channels[0].sigma / said.channels[0].sigma == pytest.approx(key.noise)
    for a, b in zip(said.parameters, true.parameters, strict=True):
        assert b.tolerance == pytest.approx(key.tolerance_scale * a.tolerance)
    assert set(key.wild) <= set(key.rows)
    perfect = draw_case(Tiny(), schedule.Seat(7, stratum, schedule.PERFECT, "tiny"), 3).solution
    assert (perfect.noise, perfect.tolerance_scale, perfect.wild) == (1.0, 1.0, ())


@every_machine
def test_wild_rows_are_the_ones_that_are_off(name: str) -> None:
    setup, rng = _setup(name), np.random.default_rng(1)
    kind = replace(misstated(rng), wild=0.04)
    exact, sigma, columns = setup.clean, setup.sigma, setup.machine.columns
    assert not wild_rows(exact, exact, sigma, columns).any()
    read = noisy(setup.machine, exact, setup.campaign, rng, replace(kind, noise=1.0))
    gone = gone_wild(exact, read, sigma, kind.wild, rng)
    touched = np.any(gone != read, axis=1)
    assert 1 <= touched.sum() <= 1 + 0.04 * len(exact)
    assert wild_rows(exact, gone, sigma, columns)[touched].mean() >= 0.5  # half are grossly off, or about
    assert not np.any(
        wild_rows(exact, gone, sigma, columns) & ~touched & ~wild_rows(exact, read, sigma, columns)
    )
    # a reading that has no noise, a change since its own row, stays exact even where all rows go wild
    for _ in range(8):
        everywhere = gone_wild(exact, read, sigma, 1.0, rng)
        assert np.array_equal(everywhere == exact, read == exact)
    assert np.any(read == exact) == (name == "nanopositioner")


class Blundering(Arm):
    """An arm that has nothing but rows that are off."""

    def kinds(self) -> tuple[Kind, ...]:
        return tuple(kind for kind in super().kinds() if kind.slug == "outliers")


def test_rows_that_were_put_in_as_wild_are_in_the_key_and_conceal_nothing() -> None:
    key = draw_case(Blundering(), schedule.Seat(2, "single", schedule.PERFECT, "arm"), 3).solution
    (truth,) = key.truths
    assert truth.effect == "outliers" and not key.concealed
    assert 1 <= len(key.wild) <= 4 and set(key.wild) <= set(key.rows)
    assert key.free_chi2_linear is not None and 0.6 < key.free_chi2_linear < 1.5  # without them all is well


def test_no_case_is_lost_because_the_product_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def stuck(*_: object, **__: object) -> None:
        raise ConvergenceError("no minimum")

    seat = schedule.Seat(3, "concealed", schedule.MISSTATED, "tiny")
    whole = draw_case(Tiny(), seat, 5)
    for module in ("references", "imitations"):
        monkeypatch.setattr(f"challenge.{module}.estimate", stuck)
    bare = draw_case(Tiny(), seat, 5)
    assert (bare.machine, bare.recording, bare.held_out) == (whole.machine, whole.recording, whole.held_out)
    assert whole.solution.missing == ()
    assert set(bare.solution.missing) == {"ordinary fit", "free fit", "imitations", "oracle"}
    assert bare.solution.concealed and bare.solution.before is None
    assert bare.solution.geometry == whole.solution.geometry
    assert bare.solution.empirical == whole.solution.empirical


def test_concealment_is_the_free_fits_to_first_order() -> None:
    """On a machine that is nearly linear within its tolerances both sides find the same chi2."""
    for stratum in ("concealed", "single", "two"):
        key = draw_case(Tiny(), schedule.Seat(9, stratum, schedule.MISSTATED, "tiny"), 6).solution
        assert key.free_chi2_per_dof == pytest.approx(key.free_chi2_linear, rel=0.02)


@pytest.mark.parametrize("beside", [False, True])
def test_a_direction_beside_takes_its_share(beside: bool) -> None:
    """What another effect of any size follows is gone; the rest is what least squares leaves of it."""
    rng = np.random.default_rng(2)
    setup = Setup.draw(Tiny(), Tiny().specimen(rng), Plan(poses=20), rng)
    a = setup.change(Imperfection("gain", ("q1",), 1e-4))
    b = setup.change(Imperfection("play", ("q2",), 2e-4)) + 0.7 * a
    columns = np.column_stack([setup.bench.jacobian, *([b] if beside else [])])
    weight = np.append(setup.bench.weight, [0.0] * beside)
    stacked, target = np.vstack([columns, np.diag(weight)]), np.append(a, np.zeros(len(weight)))
    left = target - stacked @ np.linalg.lstsq(stacked, target, rcond=None)[0]
    assert setup.bench.snr(a, [b] if beside else []) == pytest.approx(float(np.linalg.norm(left)), rel=1e-6)


def test_a_direction_that_geometry_follows_wholly_takes_nothing_more() -> None:
    """A constant without tolerance follows its own direction; what rounding leaves of that is no direction."""
    rng = np.random.default_rng(6)
    slopes, clean = rng.standard_normal((30, 1, 2)), np.zeros((30, 1))
    free = tuple(Constant(f"c{k}", 1.0, 0.01, 0.0, 0.0, False) for k in range(2))
    bench = Adaptation(("x",), clean, np.ones(1), slopes, free, np.ones(30, dtype=bool))
    change, own = rng.standard_normal(30), slopes[:, 0] @ np.array([0.3, 1.7])
    assert bench.snr(change, [own]) == pytest.approx(bench.snr(change), rel=1e-9)
    assert bench.snr(own) < 1e-9


@every_machine
def test_joints_move_their_own_rows_only(name: str) -> None:
    """Derivatives by joints, told row by row, make the change of all rows at once, compared as the sensor compares."""
    setup = _setup(name)
    slopes, whole = by_joints(setup.machine, setup.specimen, setup.whole), setup.whole
    step = 1e-5 * np.random.default_rng(3).standard_normal(whole.q.shape)
    moved = setup.machine.measure(setup.specimen, (), replace(whole, q=whole.q + step))
    expected = np.einsum("nkj,nj->nk", slopes, step)
    if np.any(whole.origin != np.arange(len(whole))):
        expected = expected - expected[whole.origin]
    change = difference(moved, setup.machine.measure(setup.specimen, (), whole), setup.machine.columns)
    assert np.allclose(change, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max(axis=0))
