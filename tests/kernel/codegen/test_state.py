"""Drivers that remember in the generated C: the same values as over a recording in Python, in a struct that the caller owns."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

import truepose
from support.examples import by_day
from support.generated_c import COMPILER, WARNINGS, needs_compiler
from support.simulated import machine_from
from support.wrapped import python_at
from truepose.codegen.c import generate, render
from truepose.codegen.features import Features
from truepose.codegen.printer import Real
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
HEAD = """schema: truepose/machine/1
name: mem
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-170, 170]}
    - {name: q2, kind: revolute, d: 325, range: [-140, 140]}
    - {name: q3, kind: prismatic, alpha: 0.1, d: 275, range: [-200, 0]}
    - {name: q4, kind: revolute, alpha: 179.9}
drivers: [temperature.link1, temperature.base, payload]
sensor: {type: position, sigma: {xyz: 0.01}}
effects:
"""
EFFECTS = """  - {effect: backlash, place: [q1], parameters: {b: {value: 4.0e-4, unit: rad}}}
  - {effect: backlash, place: [q3], parameters: {b: {value: 0.02, unit: mm}}}
  - {effect: friction-hysteresis, place: [q2], width: 0.03, parameters: {h: {value: 3.0e-4, unit: rad}}}
  - {effect: piezo-hysteresis, place: [q3], parameters: {w1: {value: 0.01, unit: "1"}, w3: {value: 0.02, unit: "1"}}}
  - {effect: piezo-creep, place: [q3], t0: 0.1, parameters: {g: {value: 0.01, unit: "1"}}}
  - {effect: piezo-creep, place: [q2], t0: 2, parameters: {g: {value: 0.01, unit: "1"}}}
  - {effect: thermal-expansion, place: [link1], lag: 300, parameters: {alpha: {value: 1.2e-5, unit: 1/K}}}
  - {effect: thermal-expansion, place: [base], parameters: {alpha: {value: 1.2e-5, unit: 1/K}}}
"""
STATED = """  - {effect: backlash, place: [q1], parameters: {b: {value: 4.0e-4, unit: rad}}}
  - {effect: friction-hysteresis, place: [q1], width: 0.01, overshoot: 0.005, parameters: {h: {value: 2.0e-4, unit: rad}}}
  - {effect: piezo-hysteresis, place: [q3], overshoot: 0.02, parameters: {w1: {value: 0.01, unit: "1"}}}
  - {effect: piezo-creep, place: [q2], t0: 0.1, dwell: 2.0, parameters: {g: {value: 0.01, unit: "1"}}}
"""
COUPLED = ", coupled: {q1: 0.5, q4: -1}"
"""Of joint q2: its drivers follow what it moves itself."""
CREEP = 1e-6
"""Share of all moves by which creep may be wrong."""
DWELL = 2.0
REALS: tuple[Real, ...] = ("double", "float")
both = pytest.mark.parametrize("real", by_day(REALS, "double"))


@dataclass(frozen=True)
class Library:
    """A machine's C with its wrapper for Python."""

    machine: Machine
    directory: Path
    wrapper: ModuleType
    kinematics: Any
    update: Any


@cache
def library(where: Path, effects: str, real: Real, coupled: str = "") -> Library:
    """The C of the machine with these effects, compiled with every warning an error."""
    file = where / "mem.yaml"
    head = HEAD.replace("140]}", f"140]{coupled}}}")
    file.write_text(head + effects, encoding="utf-8")
    machine = truepose.load_machine(file)
    directory = where / f"mem_{real}_{len(effects)}_{len(coupled)}"
    generate(machine, directory, real)
    wrapper = python_at(directory / "wrappers" / "mem_kin.py")
    kinematics = wrapper.build(COMPILER, WARNINGS)
    update = ctypes.CDLL(str(next((directory / "wrappers").glob("libmem_kin.*")))).mem_state_update
    update.argtypes = [ctypes.c_void_p, ctypes.c_void_p, wrapper.REAL, ctypes.c_void_p, ctypes.c_void_p]
    return Library(machine, directory, wrapper, kinematics, update)


def motion(seed: int, rows: int) -> pd.DataFrame:
    """Rows of a campaign in three sessions under one clock: long ways, small steps, trembling, rests, turns."""
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-5, 0, (rows, 4)) * rng.choice([0, 1, 1, 1], (rows, 4))
    step = scale * rng.choice([-1, 1], (rows, 4)) * [120, 100, 70, 90]
    q = np.empty((rows, 4))
    q[0] = [0, 10, -100, 5]
    low, high = np.array([[-170, -140, -200, -180], [170, 140, 0, 180]])
    for k in range(1, rows):
        q[k] = np.clip(q[k - 1] + step[k], low, high)
    dt = 10.0 ** rng.uniform(-2, 3, rows) * rng.choice([0, 1, 1, 1, 1], rows)
    frame = pd.DataFrame(q, columns=["q1", "q2", "q3", "q4"])
    frame["time"] = np.cumsum(dt)
    frame["session"] = np.searchsorted([rows // 3, rows // 2], np.arange(rows), side="right") + 1
    for place in ("link1", "base"):
        frame[f"temperature.{place}"] = 22 + np.cumsum(rng.normal(0, 0.3, rows))
    return frame.assign(x=0.0, y=0.0, z=0.0)


def in_python(machine: Machine, frame: pd.DataFrame, names: list[str]) -> tuple[Array, Array]:
    """Joints (n, 4) as the program has them, and drivers (n, nz) of the recording."""
    recording = truepose.load_recording(machine, [frame])
    columns = []
    for name in names:
        values = recording.driver(name)
        assert values is not None, name
        columns.append(values)
    return np.array(recording.q), np.column_stack(columns)


def allowed(names: list[str], q: Array, real: Real) -> Array:
    """How far each driver may be off: rounding of its sums, and what exponentials cannot follow of creep."""
    rounding = 1e-10 if real == "double" else 2e-5 * (1 + np.abs(q).max())
    moved = np.abs(np.diff(q, axis=0)).sum()
    return np.array([rounding + (CREEP * moved if name.startswith("creep") else 0.0) for name in names])


@needs_compiler
@both
@pytest.mark.parametrize(
    ("seed", "coupled"),
    by_day([*((k, "") for k in range(6)), (6, COUPLED), (7, COUPLED)], (0, ""), (6, COUPLED)),
)
def test_values_are_those_of_a_recording(root_directory: Path, real: Real, seed: int, coupled: str) -> None:
    built = library(root_directory, EFFECTS, real, coupled)
    names = list(built.wrapper.DRIVERS)
    assert len([name for name in names if "~" in name or name.startswith("approach")]) == 10
    frame = motion(seed, 150)
    q, expected = in_python(built.machine, frame, names)
    state = built.wrapper.State(built.kinematics, np.ptp(q, axis=0))
    time, session = frame["time"].to_numpy(), frame["session"].to_numpy()
    slack = allowed(names, q, real)
    if real == "float":  # decisions at a threshold may fall the other way
        q = q.astype(np.float32).astype(float)
        expected = in_python(built.machine, rounded(frame, q), names)[1]
    for k in range(len(q)):
        if k and session[k] != session[k - 1]:
            state.session()
        sensed = {name: float(frame[name].iloc[k]) for name in built.wrapper.SENSED}
        z = np.array(state.update(q[k], float(time[k] - time[k - 1]) if k else 0.0, sensed))
        off = np.abs(z - expected[k])
        assert (off <= slack).all(), f"row {k}: {names[int(np.argmax(off / slack))]} off by {off.max()}"


def rounded(frame: pd.DataFrame, q: Array) -> pd.DataFrame:
    """The frame with joints in single precision."""
    turning = [True, True, False, True]
    own = {f"q{k + 1}": np.degrees(q[:, k]) if turn else q[:, k] for k, turn in enumerate(turning)}
    return frame.assign(**own)


@needs_compiler
@pytest.mark.parametrize("seed", by_day(range(4), 0))
def test_a_stated_arrival_is_a_way_from_behind(root_directory: Path, seed: int) -> None:
    """Where a recording states sides, ways behind goals and waits, a controller goes there: by two updates a row."""
    built = library(root_directory, STATED, "double")
    names, rng = list(built.wrapper.DRIVERS), np.random.default_rng(seed)
    frame = motion(seed, 80)
    frame["time"] = np.cumsum(rng.uniform(3, 50, len(frame)))
    for joint in ("q1", "q3"):
        frame[f"approach.{joint}"] = rng.choice([-1, 1], len(frame))
    q, expected = in_python(built.machine, frame, names)
    state = built.wrapper.State(built.kinematics, np.ptp(q, axis=0))
    of_the_way = [name.partition(".")[2].split("~") for name in names if name.startswith(("stop", "loop"))]
    behind_by = {joint: min(float(tail[-1]), 4 * float(tail[0])) for joint, *tail in of_the_way}
    for k in range(len(q)):
        fresh = k == 0 or frame["session"].iloc[k] != frame["session"].iloc[k - 1]
        if fresh:
            state.session()
        behind = q[k].copy()
        for j, joint in ((0, "q1"), (2, "q3")):
            sides = frame[f"approach.{joint}"].to_numpy()
            rested = not fresh and q[k, j] == q[k - 1, j] and sides[k] == sides[k - 1]
            behind[j] -= 0.0 if rested else sides[k] * behind_by[joint]
        wait = frame["time"].diff().iloc[k] - DWELL if k else 0.0
        state.update(behind, wait)
        state.update(q[k], 0.0)
        z = np.array(state.update(q[k], DWELL))
        kept = [i for i, name in enumerate(names) if not name.startswith("creep")]
        np.testing.assert_allclose(z[kept], expected[k][kept], rtol=0, atol=1e-9)
        creep = [i for i, name in enumerate(names) if name.startswith("creep")]
        moved = CREEP * np.abs(np.diff(q[:, 1])).sum()
        np.testing.assert_allclose(z[creep], expected[k][creep], rtol=0, atol=moved)


@needs_compiler
@both
def test_heat_that_lags_is_followed_at_the_rate_of_a_controller(root_directory: Path, real: Real) -> None:
    """A thousand small parts a second add up: single precision forgets none of them."""
    built = library(root_directory, EFFECTS, real)
    place = list(built.wrapper.DRIVERS).index("temperature.link1~300")
    state, q, dt = built.wrapper.State(built.kinematics), np.zeros(4), 1e-3
    state.update(q, 0.0, {"temperature.link1": 20.0})
    state.update(q, 0.0, {"temperature.link1": 25.0})
    count = 60_000
    for _ in range(count):
        z = state.update(q, dt, {"temperature.link1": 25.0})
    seconds = count * float(np.float32(dt) if real == "float" else dt)
    expected = 25.0 - 5.0 * np.exp(-seconds / 300.0)
    assert z[place] == pytest.approx(expected, abs=1e-9 if real == "double" else 1e-5)


@needs_compiler
@both
def test_bad_input_is_refused_and_changes_nothing(root_directory: Path, real: Real) -> None:
    built = library(root_directory, EFFECTS, real)
    state = built.wrapper.State(built.kinematics)
    q = np.array([0.1, 0.2, -90.0, 0.3])
    for k in range(3):
        state.update(q + k, 0.5)
    before = bytes(state.memory)
    update, number = built.update, built.wrapper.REAL
    z = (number * built.wrapper.NZ)(*[-7.0] * built.wrapper.NZ)
    bad_q, bad_sensed = (number * 4)(*q[:3], np.nan), (number * 2)(20.0, np.inf)
    good_q, good_sensed = (number * 4)(*q), (number * 2)(20.0, 20.0)
    memory = ctypes.addressof(state.memory)
    for joints, dt, sensed in (
        (bad_q, 0.5, good_sensed),
        (good_q, 0.5, bad_sensed),
        (good_q, -0.5, good_sensed),
        (good_q, float("nan"), good_sensed),
        (good_q, float("inf"), good_sensed),
    ):
        at = [ctypes.addressof(joints), dt, ctypes.addressof(sensed), ctypes.addressof(z)]
        assert update(memory, *at) == 4
        assert bytes(state.memory) == before
        assert set(z) == {-7.0}
    with pytest.raises(built.wrapper.BadInputError):
        built.wrapper.State(built.kinematics, [1.0, -1.0, 1.0, 1.0])
    with pytest.raises(KeyError, match="expected names of SENSED"):
        state.update(q, 0.5, {"temperature.linc1": 3.0})
    assert state.update(q, 0.5) is not None


@needs_compiler
def test_the_state_of_cpp(root_directory: Path, tmp_path: Path) -> None:
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("no C++ compiler found")
    built = library(root_directory, EFFECTS, "double")
    (tmp_path / "main.cpp").write_text(
        """#include "mem_kin.hpp"
int main()
{
    mem_kin::State memory;
    mem_kin::Drivers z = mem_kin::usual();
    mem_kin::Joints q{0.1, 0.2, -50.0, 0.0}, command{};
    if (memory.update(q, 0.0, z) != mem_kin::Code::solved) return 1;
    q[0] += 0.2;
    if (memory.update(q, 0.01, mem_kin::Sensed{25.0, 21.0}, z) != mem_kin::Code::solved) return 2;
    if (!(z[mem_Z_approach_q1] == 1.0)) return 3;
    if (memory.update(q, -1.0, z) != mem_kin::Code::bad_input) return 4;
    return mem_kin::compensate(q, command, {nullptr, &z}) == mem_kin::Code::solved ? 0 : 5;
}
"""
    )
    d = built.directory
    for part in ("kin", "state"):
        subprocess.run(
            ["gcc", "-std=c99", "-c", d / f"mem_{part}.c", "-o", tmp_path / f"{part}.o"], check=True
        )
    flags = ["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{d}", f"-I{d / 'wrappers'}"]
    objects = [tmp_path / f"{part}.o" for part in ("kin", "state")]
    subprocess.run(
        [compiler, *flags, tmp_path / "main.cpp", *objects, "-lm", "-o", tmp_path / "main"], check=True
    )
    assert subprocess.run([tmp_path / "main"], check=False).returncode == 0


def test_there_is_a_state_where_something_remembers_or_it_is_asked_for(root_directory: Path) -> None:
    (root_directory / "plain.yaml").write_text(
        HEAD.replace("name: mem", "name: plain").replace("effects:\n", "")
    )
    plain = truepose.load_machine(root_directory / "plain.yaml")
    assert "plain_state.c" not in render(plain, "double")
    asked = render(plain, "double", features=Features.of("warm,state"))
    assert "plain_state.c" in asked and "#define plain_HAS_STATE 1" in asked["plain_kin.h"]
    machine = machine_from(root_directory, HEAD + EFFECTS, "mem")
    without = render(machine, "double", features=Features.of("warm"))
    assert "mem_state.c" not in without and "#define mem_HAS_STATE 0" in without["mem_kin.h"]


@needs_compiler
def test_a_new_session_forgets_the_way_and_not_the_heat(root_directory: Path) -> None:
    built = library(root_directory, EFFECTS, "double")
    names = list(built.wrapper.DRIVERS)
    state = built.wrapper.State(built.kinematics)
    for k in range(5):
        z = dict(
            zip(
                names,
                state.update([0.3 * k, 0.1 * k, -100.0 + 9 * k, 0], 60.0, {"temperature.link1": 20.0 + k}),
                strict=True,
            )
        )
    assert z["approach.q1"] == z["approach.q3"] == 1.0
    state.session()
    after = dict(
        zip(names, state.update([1.2, 0.4, -64.0, 0], 60.0, {"temperature.link1": 24.0}), strict=True)
    )
    assert (
        after["approach.q1"]
        == after["approach.q3"]
        == after[next(n for n in names if n.startswith("stop"))]
        == 0.0
    )
    assert z["temperature.link1~300"] < after["temperature.link1~300"] < 24.0
    assert after["creep.q3~0.1"] > z["creep.q3~0.1"] > 0.0


@pytest.mark.nightly
@needs_compiler
@both
def test_example_and_state_run_clean_under_sanitizers(
    root_directory: Path, tmp_path: Path, real: Real, sanitizers: list[str]
) -> None:
    built = library(root_directory, EFFECTS, real)
    assert COMPILER is not None
    files = [str(built.directory / name) for name in ("example.c", "mem_kin.c", "mem_state.c")]
    command = [COMPILER, *WARNINGS, "-O1", *sanitizers, *files, "-lm", "-o", str(tmp_path / "example")]
    subprocess.run(command, check=True)
    ran = subprocess.run([tmp_path / "example"], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (0, ""), ran.stdout


@needs_compiler
def test_output_may_be_what_was_sensed_and_states_are_apart(root_directory: Path) -> None:
    built = library(root_directory, EFFECTS, "double")
    one, other, alone = (built.wrapper.State(built.kinematics) for _ in range(3))
    rng = np.random.default_rng(7)
    for _ in range(40):
        q, t = rng.uniform([-2, -2, -200, -3], [2, 2, 0, 3]), rng.uniform(15, 30, 2)
        expected = alone.update(q, 0.7, dict(zip(built.wrapper.SENSED, t, strict=True)))
        other.update(-q, 3.0)  # another machine in the same program
        shared = np.zeros(built.wrapper.NZ)
        shared[:2] = t
        at = shared.ctypes.data
        assert (
            built.update(ctypes.addressof(one.memory), np.ascontiguousarray(q).ctypes.data, 0.7, at, at) == 0
        )
        np.testing.assert_array_equal(shared, expected)
