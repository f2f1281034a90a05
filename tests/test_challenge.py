"""The examination as a whole, on a machine small enough to be quick: two joints, a tool, a tracker."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from truepose.challenge import examine, schedule, solutions
from truepose.challenge.cases import Case, draw_case
from truepose.challenge.rivals import rivals
from truepose.challenge.schedule import SHARES, Seat
from truepose.challenge.setup import Setup, Setups
from truepose.challenge.simulator.base import (
    Campaign,
    Imperfection,
    Kind,
    Place,
    Plan,
    SimulatedMachine,
    Specimen,
)
from truepose.challenge.sizing import LARGEST, LIMIT_SNR, detection_limit
from truepose.challenge.strata import UndrawnError
from truepose.cli import app
from truepose.identification.prediction.predictor import Predictor

Array = NDArray[np.float64]
SIGMA, LENGTH, ANGLE = 0.01, 0.1, 0.0005
MACHINE = """schema: truepose/machine/1
name: tiny
units: {{length: mm, angle: deg}}
mechanism:
  type: serial
  joints:
    - {{name: q1, kind: revolute, r: 300, range: [-170, 170]}}
    - {{name: q2, kind: revolute, alpha: -90, d: 100, range: [-90, 90]}}
frames: {{tool: {{in: flange, xyz: [400, 50, 30], tolerance: {{xyz: {length}}}}}}}
sensor: {{type: position, sigma: {{xyz: {sigma}}}}}
tolerances: {{length: {length}, angle: {angle}}}
"""
NOMINAL = {
    "q1.alpha": 0.0, "q1.beta": 0.0, "q1.d": 0.0, "q1.theta": 0.0, "q1.r": 300.0,
    "q2.alpha": -np.pi / 2, "q2.beta": 0.0, "q2.d": 100.0, "q2.theta": 0.0, "q2.r": 0.0,
    "tool.x": 400.0, "tool.y": 50.0, "tool.z": 30.0,
}  # fmt: skip


class Tiny(SimulatedMachine):
    """Forward kinematics written out; gains, plays and a wave that no catalogue has."""

    name: ClassVar[str] = "tiny"
    readings: ClassVar[tuple[str, ...]] = ("q1", "q2")
    revolute: ClassVar[tuple[bool, ...]] = (True, True)
    columns: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    column_units: ClassVar[tuple[str, ...]] = ("mm", "mm", "mm")

    def machine_text(self, *, sigma_factor: float = 1.0, tolerance_factor: float = 1.0) -> str:
        lengths, angles = LENGTH * tolerance_factor, float(np.degrees(ANGLE)) * tolerance_factor
        return MACHINE.format(length=lengths, angle=angles, sigma=SIGMA * sigma_factor)

    def kinds(self) -> tuple[Kind, ...]:
        joints = (("q1",), ("q2",))
        return (
            Kind("gain", joints, 1e-4, "actuator-scale"),
            Kind("slip", (("q2.d",),), 0.5, "wrong-constant", conceals=True),
            Kind("play", joints, 2e-4, "backlash", ("approach.q1", "approach.q2")),
            Kind("beat", (("q1",),), 2e-4),
        )

    def shape(self, kind: str, place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"phase": float(rng.uniform(0, 6))} if kind == "beat" else {}

    def specimen(self, rng: np.random.Generator, *, scale: float = 1.0) -> Specimen:
        spread = {n: LENGTH if n[-1] in "drxyz" else ANGLE for n in NOMINAL}
        return Specimen({n: v + scale * spread[n] * rng.standard_normal() for n, v in NOMINAL.items()})

    def campaign(self, plan: Plan, rng: np.random.Generator) -> Campaign:
        n, low = plan.poses * plan.repeats, 0.8 if plan.extreme else 0.0
        limits = np.radians([170.0, 90.0])
        q = limits * rng.uniform(low, 0.95, (plan.poses, 2)) * rng.choice([-1, 1], (plan.poses, 2))
        side = rng.choice([-1.0, 1.0], (n, 2)) if plan.both_sides else np.ones((n, 2))
        pose = np.tile(np.arange(plan.poses), plan.repeats)
        return Campaign(
            q=np.radians(np.degrees(q).round(6))[pose],
            time=np.arange(0.0, 60.0 * n, 60.0),
            pose=pose + 1,
            approach=side,
            session=np.repeat(np.arange(plan.sessions), -(-n // plan.sessions))[:n] + 1,
            payload=rng.choice([0.0, 5.0], n) if plan.loads else np.zeros(n),
            temperatures={"link1": 20 + 3 * rng.random(n) if plan.heat else np.full(n, 20.0)},
            pressure=np.full(n, 1013.0),
            validation=np.full(n, plan.extreme),
            origin=np.arange(n),
        )

    def measure(
        self, specimen: Specimen, imperfections: tuple[Imperfection, ...], campaign: Campaign
    ) -> Array:
        q, p = campaign.q.copy(), dict(specimen.parameters)
        for thing in imperfections:
            if thing.kind == "slip":
                p[thing.place[0]] += thing.size
                continue
            k = self.readings.index(thing.place[0])
            if thing.kind == "gain":
                q[:, k] += thing.size * campaign.q[:, k]
            elif thing.kind == "play":
                q[:, k] -= thing.size / 2 * campaign.approach[:, k]
            elif thing.kind == "beat":
                wave = np.sin(23.7 * campaign.q[:, 0] * campaign.q[:, 1] + thing.shape["phase"])
                q[:, k] += thing.size * wave * np.sign(campaign.q[:, 1])
            else:
                raise ValueError(f"found kind {thing.kind!r}")
        point = np.tile([p["tool.x"], p["tool.y"], p["tool.z"]], (len(q), 1))
        for k, joint in ((1, "q2"), (0, "q1")):
            about_z = Rotation.from_rotvec(np.outer(q[:, k] + p[f"{joint}.theta"], [0.0, 0.0, 1.0]))
            up, out = np.array([0.0, 0.0, p[f"{joint}.r"]]), np.array([p[f"{joint}.d"], 0.0, 0.0])
            point = about_z.apply(point + up) + out
            turn = Rotation.from_euler("y", p[f"{joint}.beta"]) * Rotation.from_euler(
                "x", p[f"{joint}.alpha"]
            )
            point = turn.apply(point)
        return np.asarray(point)

    def noisy(
        self, exact: Array, campaign: Campaign, rng: np.random.Generator, *, factor: float = 1.0
    ) -> Array:
        out: Array = exact + factor * SIGMA * rng.standard_normal(exact.shape)
        return out


@pytest.fixture(autouse=True)
def tiny_world(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(examine, "machines", lambda: {"tiny": Tiny})


@pytest.fixture(scope="module")
def setup() -> Setup:
    rng = np.random.default_rng(3)
    return Setup.draw(Tiny(), Tiny().specimen(rng), Plan(poses=20), rng)


def test_the_examiner_and_the_simulator_agree_where_nothing_is_missing(setup: Setup) -> None:
    blocks = Predictor(*setup.read).blocks(setup.bench.fit.p, setup.bench.fit.x)
    # both know the specimen's constants: what differs is the ninth decimal of the file
    assert np.max(np.abs(np.concatenate([b.residual for b in blocks]))) < 1e-4
    assert np.max(np.abs(setup.bench.change(setup.clean))) < 1e-4


@pytest.mark.parametrize(("kind", "place"), [("gain", "q1"), ("gain", "q2"), ("play", "q2"), ("beat", "q1")])
@pytest.mark.parametrize("start", [0.2, 3.0])
def test_at_the_detection_limit_the_signal_is_five_times_the_noise(
    setup: Setup, kind: str, place: str, start: float
) -> None:
    usual = Imperfection(kind, (place,), start * 1e-4, {"phase": 1.0})
    limit = detection_limit(setup.bench, setup.change, usual)
    assert limit is not None
    at = setup.change(usual.scaled(limit / usual.size))
    assert setup.bench.snr(at) == pytest.approx(LIMIT_SNR, rel=0.011)


def test_the_ratio_is_that_of_the_evidence(setup: Setup) -> None:
    """D' V^-1 D with V = I + J J', written out."""
    delta = setup.change(Imperfection("gain", ("q2",), 1e-4))
    scaled = setup.bench.jacobian / setup.bench.weight
    variance = np.eye(len(delta)) + scaled @ scaled.T
    assert setup.bench.snr(delta) ** 2 == pytest.approx(delta @ np.linalg.solve(variance, delta), rel=1e-8)


def test_what_geometry_swallows_needs_a_larger_size(setup: Setup) -> None:
    free = float(np.linalg.norm(delta := setup.change(Imperfection("gain", ("q2",), 1e-4))))
    assert setup.bench.snr(delta) < free
    assert setup.bench.snr(delta, [delta]) < 1e-6 * free


def test_the_true_effect_reproduces_its_own_change(setup: Setup) -> None:
    delta = setup.change(Imperfection("gain", ("q1",), 1e-4))
    found = {
        (setup.bench.catalogue.candidates[r.signature.index].label): r for r in rivals(setup.bench, delta)
    }
    own, other = found["actuator-scale@q1"], found["actuator-scale@q2"]
    assert own.missed < 1e-2 and own.allowed
    assert other.missed > 6.0


def test_a_wrong_sign_is_no_explanation(setup: Setup) -> None:
    delta = -setup.change(Imperfection("play", ("q2",), 4e-4))
    found = {setup.bench.catalogue.candidates[r.signature.index].label: r for r in rivals(setup.bench, delta)}
    assert found["backlash@q2"].missed < 1e-2
    assert not found["backlash@q2"].allowed  # play is never negative


@pytest.mark.parametrize("n", [7, 40, 200])
def test_any_number_of_cases_holds_the_shares(n: int) -> None:
    seats = schedule.schedule(n, [f"m{k}" for k in range(7)])
    assert seats == schedule.schedule(200, [f"m{k}" for k in range(7)])[:n]
    for stratum, share in SHARES.items():
        own = [s for s in seats if s.stratum == stratum]
        assert abs(len(own) - share * n / 200) <= 1
        machines = [sum(s.machine == f"m{k}" for s in own) for k in range(7)]
        assert max(machines) - min(machines) <= 1
    clean = sum(s.variant == "clean" for s in seats)
    assert abs(clean - n / 10) <= 2


@pytest.fixture(scope="module")
def drawn() -> dict[str, Case]:
    return {s: draw_case(Tiny(), Seat(k, s, "", "tiny"), 5) for k, s in enumerate(SHARES, start=1)}


def test_a_case_follows_from_seed_and_number() -> None:
    seat = Seat(4, "single", "", "tiny")
    first, again, other = (draw_case(Tiny(), seat, seed) for seed in (5, 5, 6))
    assert first == again
    assert first.recording != other.recording
    assert solutions.to_text(first.solution) == solutions.to_text(again.solution)


def test_every_stratum_holds_what_it_says(drawn: dict[str, Case]) -> None:
    of = {stratum: case.solution for stratum, case in drawn.items()}
    assert not of["null"].truths and not of["null"].concealed
    assert of["concealed"].concealed and of["concealed"].free_chi2_per_dof < 1.3
    a, b = of["two"].truths
    assert a.effect != b.effect and a.place != b.place
    (outside,) = of["out-of-library"].truths
    assert not outside.effect and of["out-of-library"].oracle is None
    for stratum, solution in of.items():
        least = 1.0 if stratum == "single" else 3.0
        for truth in solution.truths:
            assert least * 0.999 <= truth.factor <= 20.001
            assert truth.size <= LARGEST * truth.typical * 1.001
            # the effects here are linear: the ratio is as many limits as the size
            assert truth.snr == pytest.approx(LIMIT_SNR * truth.factor, rel=0.03)


def test_the_oracle_knows_better_than_the_fit_without_effects(drawn: dict[str, Case]) -> None:
    solution = drawn["two"].solution
    assert solution.oracle is not None and len(solution.oracle.effects) == 2
    assert (solution.oracle.held_out or 9) < (solution.before.held_out or 0)
    assert (solution.oracle.bias or 9) < (solution.before.bias or 0)


def test_a_key_is_read_as_it_was_written(drawn: dict[str, Case], tmp_path: Path) -> None:
    for case in drawn.values():
        (tmp_path / "key.json").write_text(solutions.to_text(case.solution))
        assert solutions.from_file(tmp_path / "key.json") == case.solution


class Poor(Tiny):
    """A machine with one thing to get wrong."""

    name: ClassVar[str] = "poor"

    def kinds(self) -> tuple[Kind, ...]:
        return (Kind("gain", (("q1",),), 1e-4, "actuator-scale"),)


def test_a_machine_that_has_nothing_to_offer_is_said_so() -> None:
    with pytest.raises(UndrawnError, match=r"poor: .* 'two'"):
        draw_case(Poor(), Seat(1, "two", "", "poor"), 1)


def test_what_a_machine_cannot_offer_another_one_does(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(examine, "machines", lambda: {"tiny": Tiny, "poor": Poor})
    asked = examine.challenge(tmp_path, 1, seed=1)
    examine._write(asked, Seat(1, "two", "", "poor"))
    solution = solutions.from_file(tmp_path / "answers" / "case001.json")
    assert (solution.machine, len(solution.truths)) == ("tiny", 2)


def test_kinds_are_measured_by_the_plan_that_they_need() -> None:
    setups = Setups(Tiny(), Tiny().specimen(np.random.default_rng(1)), 2, sessions=1)
    joint = (("q1",),)
    plain = Kind("gain", joint, 1e-4)
    assert setups.of([plain]).campaign.session.max() == 1
    assert setups.of([plain, Kind("step", joint, 1.0, needs=("session",))]).campaign.session.max() == 2
    assert setups.of([plain]) is setups.of([plain])


def _run(*words: str) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["challenge", *words])
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture(scope="module")
def examined(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("examination")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(examine, "machines", lambda: {"tiny": Tiny})
        options = ("-n", "2", "--seed", "2", "--jobs", "1", "--strata", "null,single", "--json")
        code, out, _ = _run("-o", str(folder), *options)
    assert code == 0
    return folder, json.loads(out)


def test_two_cases_through_the_command(examined: tuple[Path, dict[str, Any]]) -> None:
    folder, summary = examined
    assert summary["cases"] == 2
    for case in ("case001", "case002"):
        assert {p.name for p in (folder / "results" / case).iterdir()} == {
            "diagnosis.json", "improved.yaml", "heldout_prediction.csv", "run.json",
        }  # fmt: skip
        assert json.loads((folder / "results" / case / "run.json").read_text())["message"] == ""
    table = (folder / "table.md").read_text()
    assert "case002" in table and "false alarms" in table
    whole = json.loads((folder / "table.json").read_text())
    assert [s["case"] for s in whole["scores"]] == ["case001", "case002"]
    assert all(s["held_out"] is not None for s in whole["scores"])


def test_the_engine_is_shown_no_truth(examined: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = examined
    keys = sorted((folder / "answers").glob("*.json"))
    assert len(keys) == 2
    for key in keys:
        solution = solutions.from_file(key)
        seen = folder / "cases" / solution.case
        assert {p.name for p in seen.iterdir()} == {"machine.yaml", "recording.csv", "heldout.csv"}
        text = "\n".join(p.read_text() for p in seen.iterdir())
        words = {solution.stratum, *(w for t in solution.truths for w in (t.kind, t.effect)), "seed", "truth"}
        assert not [w for w in words if re.search(rf"\b{re.escape(w)}\b", text)]
        numbers = {f"{abs(v):.6g}" for t in solution.truths for v in (t.size, t.limit)}
        numbers |= {f"{v:.8g}" for v in solution.geometry.truth}
        telling = [v for v in numbers if len(v.split("e")[0].lstrip("-0.")) > 5]  # 0.5 may be anything
        assert telling and not [v for v in telling if v in text]
        header = (seen / "heldout.csv").read_text().splitlines()[0].split(",")
        assert not set(header) & set(solution.held_out.columns)


def test_a_case_that_has_a_result_is_not_sat_again(
    examined: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, summary = examined
    sat: list[str] = []
    monkeypatch.setattr(examine, "sit", lambda case, *_: sat.append(case.name))
    options = ("-n", "2", "--seed", "2", "--jobs", "1", "--strata", "null,single", "--json")
    code, out, _ = _run("-o", str(folder), *options)
    assert (code, sat, json.loads(out)) == (0, [], summary)
    _run("-o", str(folder), *options, "--again")
    assert sat == ["case001", "case002"]


def test_another_examination_is_not_mixed_in(examined: tuple[Path, dict[str, Any]]) -> None:
    code, _, err = _run("-o", str(examined[0]), "-n", "2", "--seed", "3")
    assert code == 2 and "another directory" in err


@pytest.mark.parametrize("option", ["--machines", "--strata"])
def test_unknown_names_are_refused(option: str, tmp_path: Path) -> None:
    code, _, err = _run("-o", str(tmp_path / "new"), option, "nothing")
    assert code == 2 and "'nothing'" in err and len(err.splitlines()) == 1
    assert not (tmp_path / "new").exists()


def test_a_crash_and_a_timeout_are_results(tmp_path: Path) -> None:
    case = tmp_path / "case"
    case.mkdir()
    for name in ("machine.yaml", "recording.csv", "heldout.csv"):
        (case / name).write_text("nonsense: [")
    examine.sit(case, tmp_path / "crash", 60.0)
    examine.sit(case, tmp_path / "late", 0.01)
    said = {n: json.loads((tmp_path / n / "run.json").read_text())["message"] for n in ("crash", "late")}
    assert "InputError" in said["crash"] and "timeout" in said["late"]
    assert not (tmp_path / "crash" / "diagnosis.json").exists()


def test_a_case_that_cannot_be_made_is_told_and_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> Case:
        raise ValueError("no such link")

    monkeypatch.setattr(examine, "draw_case", broken)
    options = ("-n", "1", "--jobs", "1", "--strata", "single", "--json")
    code, out, _ = _run("-o", str(tmp_path / "out"), *options)
    assert (code, json.loads(out)["cases"]) == (0, 0)
    assert json.loads(out)["undrawn"] == ["case001: ValueError: no such link"]
