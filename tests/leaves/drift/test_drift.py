"""What ``drift`` owes sequences of recordings in which known parameters move, or nothing does.

Recordings come from ``support.drifting_arm``, a forward model in numpy apart from the library's.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support import MACHINES
from support.command import input_error, refused, run
from support.drifting_arm import HOUR, SIGMA, TURN_SIGMA, machine_text, tolerance, write_sequence
from support.reports import said_of
from truepose.arrays import Array
from truepose.identification.leaves.drift.analysis import Drift, drift
from truepose.identification.leaves.drift.words import drift_json, drift_notes
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine


@dataclass(frozen=True)
class Case:
    """A machine file and the files of its sessions."""

    machine: Path
    files: list[Path]

    def drift(self, order: Sequence[int] | None = None) -> Drift:
        machine = load_machine(self.machine)
        files = self.files if order is None else [self.files[k] for k in order]
        return drift(machine, load_recording(machine, files))


def sequence(
    folder: Path,
    seed: int,
    moves: Mapping[str, Sequence[float]],
    *,
    sessions: int = 4,
    every: float | None = 24 * HOUR,
    n: int = 30,
) -> Case:
    """Sessions of one arm; ``moves`` says by how much (mm, rad) a parameter is off in each of them."""
    return Case(*write_sequence(folder, seed, moves, sessions=sessions, every=every, n=n))


def movement(found: Drift, name: str) -> tuple[Array, Array]:
    """Change and 1-sigma after the first session."""
    (own,) = [m for m in found.movements if m.name == name]
    assert own.status == "moved", own
    return np.array(own.change[1:]), np.array(own.std[1:])


def moved(found: Drift) -> set[str]:
    return {m.name for m in found.moved}


@pytest.mark.parametrize("seed", range(6))
def test_a_machine_that_stays_the_same_gives_no_alarm(tmp_path: Path, seed: int) -> None:
    found = sequence(tmp_path, seed, {}).drift()
    assert not moved(found)
    assert all(m.status == "still" for m in found.movements)
    assert found.log_bayes_factor == pytest.approx(0.0, abs=1e-9)
    # 1440 - 4 * 25 readings tell the noise to two per cent
    assert found.noise == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("name", "rate"), [("q3.theta", 2e-4), ("q4.d", 0.05), ("q2.alpha", -2e-4)])
def test_a_constant_that_drifts_is_found_with_its_rate(tmp_path: Path, name: str, rate: float) -> None:
    days = np.arange(4)
    found = sequence(tmp_path, 11, {name: (rate * days).tolist()}).drift()
    assert moved(found) == {name}
    change, std = movement(found, name)
    assert np.all(np.abs(change - rate * days[1:]) < 4.0 * std)
    (own,) = found.moved
    assert own.rate is not None and own.rate_std is not None and own.steady
    assert abs(own.rate * 24 * HOUR - rate) < 4.0 * own.rate_std * 24 * HOUR
    assert own.rate_std * 24 * HOUR < 0.1 * abs(rate)
    assert not any(check.holds for check in found.durability.carried if check)


BASE = {
    "base.x": [0.0, 0.1, 0.05, 0.2],
    "base.y": [0.0, -0.1, 0.1, 0.1],
    "base.z": [0.0, 0.1, 0.1, -0.05],
    "base.rx": [0.0, 1e-4, 3e-4, -1e-4],
    "base.ry": [0.0, -2e-4, 2e-4, 0.0],
    "base.rz": [0.0, 3e-4, 2e-4, -1e-4],
}


@pytest.mark.parametrize("seed", [21, 22])
def test_a_base_set_up_anew_is_found_and_frames_alone_mend_it(tmp_path: Path, seed: int) -> None:
    found = sequence(tmp_path, seed, BASE).drift()
    assert moved(found) == set(BASE)
    off = [
        (np.array(truth[1:]) - movement(found, name)[0]) / movement(found, name)[1]
        for name, truth in BASE.items()
    ]
    assert np.max(np.abs(off)) < 4.5
    assert 0.3 < np.mean(np.square(off)) < 2.5
    assert not any(check.holds for check in found.durability.carried if check)
    assert all(check.holds for check in found.durability.frames if check)
    said = " ".join(said_of(found))
    assert "of frames and sensors: base.x, base.y, base.z, base.rx, base.ry, base.rz" in said
    assert "of the mechanism: nothing" in said
    assert "recalibrate frames and sensor constants within 1 day; the mechanism's constants hold" in said


def test_frames_alone_do_not_mend_a_joint_that_moved(tmp_path: Path) -> None:
    moves = {"tool.x": [0.0, 0.1, 0.1, 0.1], "q4.d": [0.0, 0.0, 0.0, 0.3]}
    found = sequence(tmp_path, 31, moves).drift()
    assert moved(found) == set(moves)
    assert [check.holds for check in found.durability.carried if check] == [False, False, False]
    assert [check.holds for check in found.durability.frames if check] == [True, True, False]
    (line,) = [text for text in said_of(found) if "re-identifying" in text]
    assert "suffices up to day2.csv (2 days); no longer at day3.csv (3 days): rms position" in line
    wide = drift(
        load_machine(tmp_path / "arm.yaml"),
        load_recording(load_machine(tmp_path / "arm.yaml"), [tmp_path / f"day{k}.csv" for k in (0, 3)]),
        accuracy={"position": 10.0, "rotation": 0.1},
    )
    assert all(check.holds for check in (*wide.durability.carried, *wide.durability.frames) if check)


def test_a_constant_made_wrong_is_no_movement(tmp_path: Path) -> None:
    """Off by ten tolerances in every session alike."""
    wrong = 10 * tolerance("q4.d")
    found = sequence(tmp_path, 41, {"q4.d": [wrong] * 4}).drift()
    assert not moved(found)


def test_noise_twice_as_large_as_stated_is_no_movement(tmp_path: Path) -> None:
    case = sequence(tmp_path, 42, {})
    stated, half = f"xyz: {SIGMA!r}, rot: {TURN_SIGMA}", f"xyz: {SIGMA / 2}, rot: {TURN_SIGMA / 2}"
    case.machine.write_text(machine_text().replace(stated, half), encoding="utf-8")
    found = case.drift()
    assert not moved(found)
    assert found.noise == pytest.approx(2.0, rel=0.1)
    assert all(check.holds for check in found.durability.carried if check)


def test_the_order_of_files_does_not_matter_where_there_is_a_clock(tmp_path: Path) -> None:
    case = sequence(tmp_path, 51, {"q3.theta": [0.0, 2e-4, 4e-4, 6e-4]})
    one, other = case.drift(), case.drift([2, 0, 3, 1])
    assert other.labels == one.labels == ("day0.csv", "day1.csv", "day2.csv", "day3.csv")
    assert other.log_bayes_factor == pytest.approx(one.log_bayes_factor, rel=1e-6)
    for a, b in zip(one.movements, other.movements, strict=True):
        assert (a.name, a.status) == (b.name, b.status)
        np.testing.assert_allclose(a.change, b.change, rtol=1e-5, atol=1e-10)
        np.testing.assert_allclose(a.std, b.std, rtol=1e-5)


def test_without_a_clock_sessions_are_as_given_and_rates_by_session(tmp_path: Path) -> None:
    case = sequence(tmp_path, 52, {"q3.theta": [0.0, 2e-4, 4e-4, 6e-4]}, every=None)
    found = case.drift([0, 1, 2, 3])
    assert found.times is None
    (own,) = found.moved
    assert own.rate is not None and own.rate == pytest.approx(2e-4, rel=0.1)
    assert "a session" in " ".join(said_of(found))
    backwards = case.drift([3, 2, 1, 0])
    assert backwards.labels[0] == "day3.csv"
    assert backwards.moved[0].rate == pytest.approx(-own.rate, rel=1e-3)


def test_sessions_in_one_file_are_the_same_as_files(tmp_path: Path) -> None:
    case = sequence(tmp_path, 53, {"base.z": [0.0, 0.1, 0.2, 0.3]})
    whole = pd.concat([pd.read_csv(path).assign(session=k) for k, path in enumerate(case.files)])
    whole.to_csv(tmp_path / "all.csv", index=False)
    apart, together = case.drift(), Case(case.machine, [tmp_path / "all.csv"]).drift()
    assert together.labels == tuple(f"session {k}" for k in range(4))
    assert moved(apart) == moved(together) == {"base.z"}
    np.testing.assert_allclose(movement(together, "base.z")[0], movement(apart, "base.z")[0], rtol=1e-6)


def test_what_no_recording_sees_stays_out_with_a_sentence(tmp_path: Path) -> None:
    """A point says nothing of the tool's rotation, and a first joint's offset only turns with the base."""
    case = sequence(tmp_path, 55, {"q3.theta": [0.0, 4e-4]}, sessions=2)
    text = machine_text().replace(f"{{type: pose, sigma: {{xyz: {SIGMA!r}, rot: {TURN_SIGMA}}}}}", "")
    text = (
        text.replace("sensor: ", f"sensor: {{type: position, sigma: {{xyz: {SIGMA}}}}}") + "  q1.theta: 0.2\n"
    )
    case.machine.write_text(text, encoding="utf-8")
    found = case.drift()
    assert {m.name for m in found.movements if m.status == "unseen"} == {"tool.rx", "tool.ry", "tool.rz"}
    assert moved(found) == {"q3.theta"}
    lines = " ".join(said_of(found))
    assert "no recording sees tool.rx, tool.ry, tool.rz: a movement there cannot be told" in lines
    assert re.search(r"would not be noticed: [^;]*base\.rz[^;]*q1\.theta|q1\.theta[^;]*base\.rz", lines)


def test_movements_that_show_alike_are_named_together(tmp_path: Path) -> None:
    """The tool's height and the last joint's offset: the frame is named, the joint beside it."""
    case = sequence(tmp_path, 56, {"tool.z": [0.0, 0.2, 0.4, 0.1]})
    case.machine.write_text(machine_text() + "  q5.r: 0.5\n", encoding="utf-8")
    found = case.drift()
    (own,) = found.moved
    assert own.name == "tool.z"
    assert own.alike["q5.r"] < 3.0
    (joint,) = [m for m in found.movements if m.name == "q5.r"]
    assert joint.status == "masked"
    assert "a movement of q5.r could not be told from those found" in " ".join(said_of(found))


def test_rows_that_count_from_another_session_are_left_out(tmp_path: Path) -> None:
    machine = MACHINES / "distance.yaml"
    rng = np.random.default_rng(61)
    n = 40
    poses = pd.DataFrame(
        {"pose": np.arange(n), "from": np.maximum(np.arange(n) - 1, 0), "session": np.arange(n) // 20}
    )
    for name, reach in (("x", 5), ("y", 5), ("t", 3)):
        poses[name] = rng.uniform(-reach, reach, n)
    poses.to_csv(tmp_path / "poses.csv", index=False)
    run("simulate", machine, tmp_path / "poses.csv", "-o", tmp_path / "read.csv")
    loaded = load_machine(machine)
    found = drift(loaded, load_recording(loaded, [tmp_path / "read.csv"]))
    assert any("row 21: counts from a row of another session" in note for note in drift_notes(found))
    assert found.n_observations == (19, 19)  # the first row reads 0, the 21st is left out
    assert not moved(found)


def test_one_session_is_refused(tmp_path: Path) -> None:
    case = sequence(tmp_path, 62, {}, sessions=1)
    with input_error(r"day0\.csv: found 1 session to fit, expected at least two"):
        case.drift()


def test_a_machine_that_is_exactly_known_is_refused(tmp_path: Path) -> None:
    case = sequence(tmp_path, 63, {}, sessions=2, n=3)
    text = re.sub(r"tolerance: \{[^}]*\}", "tolerance: {xyz: 0, rpy: 0}", machine_text())
    case.machine.write_text(text.partition("  q2.alpha: ")[0], encoding="utf-8")
    with input_error("found no free parameter"):
        case.drift()


def test_files_of_one_name_keep_their_paths(tmp_path: Path) -> None:
    case = sequence(tmp_path, 64, {}, sessions=2, n=20, every=None)
    files = []
    for path in case.files:
        (tmp_path / path.stem).mkdir()
        files.append(tmp_path / path.stem / "read.csv")
        path.rename(files[-1])
    assert Case(case.machine, files).drift().labels == tuple(map(str, files))


def test_the_command_writes_json_and_a_page(tmp_path: Path) -> None:
    case = sequence(tmp_path, 71, {"q3.theta": [0.0, 4e-4]}, sessions=2, n=20)
    lines = run("drift", case.machine, *case.files, "-o", tmp_path / "out", "--accuracy", "5 um").stdout
    assert "q3.theta: " in lines and str(tmp_path / "out" / "report.html") in lines
    document = json.loads((tmp_path / "out" / "drift.json").read_text(encoding="utf-8"))
    assert document["schema"] == "truepose/drift/1"
    assert document["moved"] == ["q3.theta"]
    assert document["parameters"]["q3.theta"]["rate"]["unit"] == "rad/s"
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "q3.theta" in page and "<html" in page and page.count("http-equiv") == 1
    assert 'http-equiv="Content-Security-Policy"' in page
    printed = json.loads(run("drift", case.machine, *case.files, "--json").stdout)
    assert printed["command"] == "drift" and printed["parameters"] == document["parameters"]
    assert drift_json(case.drift())["parameters"] == document["parameters"]


@pytest.mark.parametrize("text", ["fast", "5 kg", "5 parsnips", "nm"])
def test_an_accuracy_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    case = sequence(tmp_path, 72, {}, sessions=2, n=2)
    refused("drift", case.machine, *case.files, "--accuracy", text, said="--accuracy")


def test_the_unit_of_the_files_does_not_matter(tmp_path: Path) -> None:
    moves = {"q4.d": [0.0, 0.1, 0.2, 0.3]}
    plain = sequence(tmp_path, 54, moves)
    (tmp_path / "um.yaml").write_text(machine_text("um", 1e3), encoding="utf-8")
    files = []
    for path in plain.files:
        frame_ = pd.read_csv(path)
        frame_[["x", "y", "z"]] *= 1e3
        files.append(path.with_name(f"um_{path.name}"))
        frame_.to_csv(files[-1], index=False)
    one, other = plain.drift(), Case(tmp_path / "um.yaml", files).drift()
    assert moved(one) == moved(other) == {"q4.d"}
    np.testing.assert_allclose(movement(other, "q4.d"), movement(one, "q4.d"), rtol=1e-5)
