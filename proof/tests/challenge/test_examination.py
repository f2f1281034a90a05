"""The examination as a whole, on a machine small enough to be quick: two joints, a tool, a tracker."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from challenge import examine, schedule, solutions
from challenge.__main__ import app, challenge
from challenge.cases import Case, draw_case
from challenge.rivals import Rival, rivals
from challenge.schedule import SHARES, VARIANTS, Seat
from challenge.setup import Setup, Setups
from challenge.simulator.base import Imperfection, Kind, Plan
from challenge.sizing import LARGEST, LIMIT_SNR, detection_limit
from challenge.strata import UndrawnError
from proof_support.tiny_machine import Tiny
from truepose.identification.prediction.predictor import Predictor

Array = NDArray[np.float64]
EXAMPLE = re.compile(r"^\s*(?:Example|Drawn once, [^:]*): (python -m challenge .*)$", re.MULTILINE)


@pytest.fixture(autouse=True)
def tiny_world(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(examine, "machines", lambda: {"tiny": Tiny})


@pytest.fixture(scope="module")
def setup() -> Setup:
    rng = np.random.default_rng(3)
    return Setup.draw(Tiny(), Tiny().specimen(rng), Plan(poses=20), rng)


def test_the_examiner_and_the_simulator_agree_where_nothing_is_missing(setup: Setup) -> None:
    assert setup.known is not None
    blocks = Predictor(*setup.read).blocks(setup.known.fit.p, setup.known.fit.x)
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


def _against(setup: Setup, change: Array) -> dict[str, Rival]:
    """Every candidate by its label."""
    assert setup.known is not None
    labels = [c.label for c in setup.known.catalogue.candidates]
    return {labels[r.signature.index]: r for r in rivals(setup.known, change)}


def test_the_true_effect_reproduces_its_own_change(setup: Setup) -> None:
    found = _against(setup, setup.change(Imperfection("gain", ("q1",), 1e-4)))
    own, other = found["actuator-scale@q1"], found["actuator-scale@q2"]
    assert own.missed < 1e-2 and own.allowed
    assert other.missed > 6.0


def test_a_wrong_sign_is_no_explanation(setup: Setup) -> None:
    found = _against(setup, -setup.change(Imperfection("play", ("q2",), 4e-4)))
    assert found["backlash@q2"].missed < 1e-2
    assert not found["backlash@q2"].allowed  # play is never negative


@pytest.mark.parametrize("n", [7, 40, 400])
def test_any_number_of_cases_holds_the_shares(n: int) -> None:
    seats = schedule.schedule(n, [f"m{k}" for k in range(7)])
    assert seats == schedule.schedule(400, [f"m{k}" for k in range(7)])[:n]
    for stratum, share in SHARES.items():
        own = [s for s in seats if s.stratum == stratum]
        assert abs(len(own) - share * n / 400) <= 1
        machines = [sum(s.machine == f"m{k}" for s in own) for k in range(7)]
        assert max(machines) - min(machines) <= 1
    wrong = sum(s.variant == schedule.MISSTATED for s in seats if s.stratum not in ("null", "real-like"))
    assert abs(wrong - 125 * n / 400) <= 5  # half of 250, to one in each stratum


def test_every_variant_meets_every_machine() -> None:
    machines = [f"m{k}" for k in range(7)]
    seats = schedule.schedule(2000, machines)
    for stratum, variants in VARIANTS.items():
        met = {(s.variant, s.machine) for s in seats if s.stratum == stratum}
        assert met == {(v, m) for v in variants for m in machines}


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
    assert of["concealed"].concealed and (of["concealed"].free_chi2_per_dof or 9.0) < 1.3
    assert not of["concealed"].missing
    a, b = of["two"].truths
    assert a.effect != b.effect and a.place != b.place
    (outside,) = of["out-of-library"].truths
    assert not outside.effect and of["out-of-library"].oracle is None
    many = of.pop("real-like").truths
    assert len(many) >= 5 and len({(t.effect, t.place) for t in many}) == len(many)
    for stratum, solution in of.items():
        least = 1.0 if stratum in ("single", "two") else 3.0
        for truth in solution.truths:
            assert least * 0.999 <= truth.factor <= (40.001 if stratum == "two" else 20.001)
            assert truth.size <= LARGEST * truth.typical * 1.001
            # the effects here are linear: the ratio is as many limits as the size
            assert truth.snr == pytest.approx(LIMIT_SNR * truth.factor, rel=0.03)


def test_the_oracle_knows_better_than_the_fit_without_effects(drawn: dict[str, Case]) -> None:
    solution = drawn["two"].solution
    assert solution.oracle is not None and len(solution.oracle.effects) == 2
    assert solution.before is not None
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
    examine.write_case(asked, Seat(1, "two", "", "poor"))
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
    done = CliRunner().invoke(app, [*words])
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
            "diagnosis.json", "improved.yaml", "heldout_prediction.csv", "run.json", "tool_prediction.csv",
            "plain_prediction.csv",
        }  # fmt: skip
        assert json.loads((folder / "results" / case / "run.json").read_text())["message"] == ""
    table = (folder / "table.md").read_text()
    assert "case002" in table and "false alarms" in table
    whole = json.loads((folder / "table.json").read_text())
    assert [s["case"] for s in whole["scores"]] == ["case001", "case002"]
    assert all(s["held_out"] is not None for s in whole["scores"])


@pytest.fixture
def answered(examined: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Path]]:
    """Cases that are sat: the answers of the examination stand for those of other engines, which take their time."""
    sat: list[Path] = []

    def sit(case: Path, results: Path, *_: object) -> None:
        sat.append(case)
        shutil.copytree(examined[0] / "results" / case.name, results)

    monkeypatch.setattr(examine, "sit", sit)
    yield sat
    assert sat


def test_the_examples_of_the_help_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answered: list[Path]
) -> None:
    """As they stand there, on one case of a tiny machine."""
    helped = " ".join(_run("--help")[1].split())
    lines = [line for line in re.findall(EXAMPLE, challenge.__doc__ or "") if line in helped]
    commands = [part.split() for line in lines for part in line.split("; ")]
    assert [words[:3] for words in commands] == [["python", "-m", "challenge"]] * 3
    monkeypatch.chdir(tmp_path)
    for words in commands:
        fewer = ["-n", "1", "--jobs", "1", *([] if "--drawn" in words else ["--strata", "null"])]
        code, out, err = _run(*words[3:], *fewer)
        assert code == 0, out + err
    assert {p.name for p in tmp_path.iterdir()} == {"examination", "drawn", "first"}
    assert [case.parent.parent.name for case in answered] == ["examination", "drawn"]
    assert all((tmp_path / name / "table.md").is_file() for name in ("examination", "first"))


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


def test_cases_are_drawn_once_and_sat_by_several_engines(
    examined: tuple[Path, dict[str, Any]], tmp_path: Path, answered: list[Path]
) -> None:
    """They are those of an examination that draws and sits at once."""
    whole, drawn = examined[0], tmp_path / "drawn"
    strata = ("--seed", "2", "--jobs", "1", "--strata", "null,single", "--json")
    code, out, _ = _run("-o", str(drawn), "-n", "2", *strata, "--draw")
    assert (code, json.loads(out)["drawn"]) == (0, 2)
    assert sorted(p.name for p in drawn.iterdir()) == ["answers", "cases", "challenge.json"]
    before = {p: p.read_bytes() for p in drawn.rglob("*") if p.is_file()}
    assert all((whole / p.relative_to(drawn)).read_bytes() == text for p, text in before.items())
    for name, count in (("one", 1), ("two", 2)):
        sat = tmp_path / name
        code, out, _ = _run("-o", str(sat), "--drawn", str(drawn), "-n", str(count), "--jobs", "1", "--json")
        assert (code, json.loads(out)["cases"]) == (0, count)
        assert {p.name for p in sat.iterdir()} == {"results", "challenge.json", "table.md", "table.json"}
        assert len(list((sat / "results").iterdir())) == count
    assert [case.name for case in answered] == ["case001", "case001", "case002"]
    assert {case.parent for case in answered} == {drawn / "cases"}
    assert before == {p: p.read_bytes() for p in drawn.rglob("*") if p.is_file()}


def test_a_folder_without_drawn_cases_is_refused(tmp_path: Path) -> None:
    code, _, err = _run("-o", str(tmp_path / "new"), "--drawn", str(tmp_path))
    assert code == 2 and "challenge.json" in err
    code, _, err = _run("-o", str(tmp_path / "new"), "--drawn", str(tmp_path), "--draw")
    assert code == 2 and "--draw" in err
    assert not (tmp_path / "new").exists()


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
