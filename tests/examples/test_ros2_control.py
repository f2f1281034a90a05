"""The controller of ros2_control: compiled against stand-ins of ROS 2, updated along a path as a controller manager would."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from support import ROOT
from support.generated_c import COMPILER, WARNINGS, needs_compiler
from support.rail_arm import DRIVERS, NAME, STRAIGHT, Path6, compensated, parameter, planned, written
from truepose.arrays import Array

EXAMPLE = ROOT / "examples" / "ros2_control"
SOURCE = EXAMPLE / "src" / "compensation_controller.cpp"
STAND_INS = EXAMPLE / "stand_ins"
CPP = shutil.which("g++") or shutil.which("c++")
STRICT = ["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]
COUNTED = [f"-Wl,--wrap={name}" for name in ("malloc", "calloc", "realloc")]
OK, ERROR = 0, 1
TO_ROS = np.array([1e-3, 1.0, 1.0, 1.0, 1.0, 1.0])
"""mm and rad to m and rad."""
AT_ONCE = {"correction_rate": 1e9}
"""No limit to how fast the correction changes."""

pytestmark = [
    pytest.mark.nightly,
    needs_compiler,
    pytest.mark.skipif(CPP is None, reason="no C++ compiler found"),
]


@dataclass(frozen=True)
class Updates:
    """What a controller manager saw: (n,) return codes, allocations in updates, and commands (n, 6) in mm and rad."""

    codes: Array
    allocations: Array
    commands: Array
    said: str


@dataclass(frozen=True)
class Controller:
    """The compiled controller of the machine in ``folder``."""

    folder: Path
    machine: Path
    program: Path

    def start(
        self, nominal: Array, drivers: Array, given: Mapping[str, object], mode: str
    ) -> subprocess.CompletedProcess[str]:
        """The program with references in mm and rad and parameters beside the usual ones."""
        parameters = {"joints": " ".join(f"joint{k}" for k in range(1, 7)), **given}
        file = self.folder / "parameters.txt"
        file.write_text("".join(f"{name} {value}\n" for name, value in parameters.items()))
        rows = np.hstack([nominal * TO_ROS, drivers])
        names = DRIVERS if drivers.size else ()
        text = [f"#drivers {' '.join(names)}".strip(), *(" ".join(f"{v:.17g}" for v in row) for row in rows)]
        command = [str(self.program), str(file), mode]
        return subprocess.run(
            command, input="\n".join(text) + "\n", check=False, capture_output=True, text=True
        )

    def run(
        self, nominal: Array, drivers: Array, given: Mapping[str, object] = AT_ONCE, mode: str = "chained"
    ) -> Updates:
        done = self.start(nominal, drivers, given, mode)
        assert done.returncode == 0, done.stderr
        table = np.array([[float(word) for word in line.split()] for line in done.stdout.splitlines()])
        return Updates(table[:, 0], table[:, 1], table[:, 2:] / TO_ROS, done.stderr)


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Controller:
    assert CPP is not None and COMPILER is not None
    folder = tmp_path_factory.mktemp("ros2")
    machine = written(folder)
    c = folder / "controller"
    subprocess.run(
        [COMPILER, *WARNINGS, "-c", str(c / f"{NAME}_kin.c"), "-o", "kin.o"], cwd=folder, check=True
    )
    includes = [f"-I{path}" for path in (STAND_INS, c, c / "wrappers")]
    sources = [str(SOURCE), str(STAND_INS / "loop.cpp"), "kin.o"]
    command = [CPP, *STRICT, f"-DMACHINE={NAME}", *includes, *sources, *COUNTED, "-lm", "-o", "loop"]
    subprocess.run(command, cwd=folder, check=True)
    return Controller(folder, machine, folder / "loop")


@pytest.fixture(scope="module")
def path(controller: Controller) -> Path6:
    return compensated(controller.folder, controller.machine, *planned())


def same(found: Array, expected: Array) -> None:
    """Equal within what an inverse promises, 1e-6 mm and 1e-9 rad at the tool, times the reach by a singular wrist."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("mode", ["chained", "topic"])
def test_the_commands_are_those_of_truepose_compensate(
    controller: Controller, path: Path6, mode: str
) -> None:
    done = controller.run(path.nominal, path.drivers, mode=mode)
    assert not done.codes.any()
    same(done.commands, path.command)
    assert np.abs(path.command - path.nominal).max(axis=0).min() > 1e-3  # and there was something to correct


def test_updates_allocate_nothing(controller: Controller, path: Path6) -> None:
    """Nor do those that hold."""
    nominal = path.nominal.copy()
    nominal[40:60] = np.nan
    nominal[80:90, 2] = 9.0
    done = controller.run(nominal, path.drivers)
    assert done.codes.any() and not done.allocations.any()


def test_nothing_is_written_before_somebody_asks(controller: Controller, path: Path6) -> None:
    """Not a position of 0, and no error however long it takes: the drives stay as they are."""
    nominal = path.nominal[:20].copy()
    nominal[:15] = np.nan
    done = controller.run(nominal, path.drivers[:20])
    assert not done.codes.any()
    assert np.isnan(done.commands[:15]).all()
    same(done.commands[15:], path.command[15:20])


@pytest.mark.parametrize(
    ("joint", "value"),
    [(3, np.nan), (2, np.radians(121.0)), (2, STRAIGHT), (0, np.inf)],
    ids=["lost", "out of range", "a straight elbow, which the shorter real arm cannot reach", "infinite"],
)
def test_the_last_good_command_stays_and_then_the_manager_is_told(
    controller: Controller, path: Path6, joint: int, value: float
) -> None:
    nominal = path.nominal[:40].copy()
    nominal[10:20, joint] = value
    done = controller.run(nominal, path.drivers[:40], {**AT_ONCE, "tolerated_failures": 5})
    assert done.commands[10:20].tolist() == [done.commands[9].tolist()] * 10
    assert done.codes.tolist() == [OK] * 15 + [ERROR] * 5 + [OK] * 20
    same(done.commands[20:], path.command[20:40])
    assert "10 updates held the last command" in done.said


def test_failures_count_that_come_in_a_row(controller: Controller, path: Path6) -> None:
    nominal = path.nominal[:30].copy()
    nominal[np.r_[5:9, 15:19], 3] = np.nan
    done = controller.run(nominal, path.drivers[:30], {**AT_ONCE, "tolerated_failures": 4})
    assert not done.codes.any()
    assert "8 updates held the last command" in done.said


def test_the_correction_grows_no_faster_than_its_rate(controller: Controller, path: Path6) -> None:
    """Switched on, and with a payload taken up in one tick, while the robot stands."""
    still = np.tile(path.nominal[0], (600, 1))
    drivers = np.tile(path.drivers[0], (600, 1))
    drivers[300:, 0] = 60.0
    rate = 0.05
    done = controller.run(still, drivers, {"correction_rate": rate})
    steps = np.diff(np.vstack([still[0], done.commands]), axis=0) * TO_ROS
    assert np.abs(steps).max() == pytest.approx(rate * 1e-3, rel=1e-6)
    at_once = controller.run(still, drivers)
    same(done.commands[[299, 599]], at_once.commands[[299, 599]])
    assert np.abs(at_once.commands[300] - at_once.commands[299])[1] > 10 * rate * 1e-3


def test_a_new_calibration_is_a_parameter(controller: Controller, path: Path6, tmp_path: Path) -> None:
    """And is what a machine file with that value gives; no other C is compiled."""
    document = yaml.safe_load(controller.machine.read_text())
    document["mechanism"]["joints"][2]["d"] += 1.5
    changed = tmp_path / "changed.yaml"
    changed.write_text(yaml.safe_dump(document, sort_keys=False))
    other = compensated(tmp_path, changed, path.nominal[:20], path.drivers[:20])
    given = {**AT_ONCE, "calibration.q3.d": repr(parameter(controller.machine, "q3.d") + 1.5)}
    same(controller.run(path.nominal[:20], path.drivers[:20], given).commands, other.command)
    assert np.abs(other.command - path.command[:20]).max() > 1e-3


def test_drivers_may_be_parameters(controller: Controller, path: Path6) -> None:
    """What no topic tells yet; the stand-in publishes what it has at once, so nothing is published here."""
    program = controller.run(path.nominal[:5], np.tile([2.0, 27.5], (5, 1)))
    given = {**AT_ONCE, "drivers.payload": 2.0, "drivers.temperature.link2": 27.5}
    found = controller.run(path.nominal[:5], np.zeros((5, 0)), given)
    assert found.commands.tolist() == program.commands.tolist()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"calibration.q3.dd": 1.5}, "calibration.q3.dd: found no such name, expected one of arm_kin.h"),
        ({"drivers.temperature": 20.5}, "drivers.temperature: found no such name"),
        ({"calibration.q3.d": "nan"}, "calibration.q3.d: found no finite number"),
        ({"calibration.q3.d": 455}, "parameter of another type"),
        ({"joints": "a b c"}, "joints: found 3 names, expected 6"),
        ({"correction_rate": 0.0}, "expected correction_rate above 0"),
        ({"tolerated_failures": -1}, "tolerated_failures of 0 or more"),
    ],
)
def test_wrong_parameters_are_refused(
    controller: Controller, path: Path6, given: Mapping[str, object], said: str
) -> None:
    done = controller.start(path.nominal[:2], path.drivers[:2], given, "chained")
    assert done.returncode == 2 and not done.stdout
    assert said in done.stderr


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_message_with_a_mistake_changes_no_driver(
    controller: Controller, path: Path6, wrong: float
) -> None:
    drivers = path.drivers[:10].copy()
    drivers[5:, 0] = wrong  # and with it the temperatures of the same messages
    done = controller.run(path.nominal[:10], drivers)
    held = compensated(
        controller.folder, controller.machine, path.nominal[:10], path.drivers[[0, 1, 2, 3, 4, 4, 4, 4, 4, 4]]
    )
    same(done.commands, held.command)
    assert "~/drivers: expected a finite value for each name" in done.said


def test_it_compiles_for_single_precision(tmp_path: Path) -> None:
    assert CPP is not None
    written(tmp_path, "float")
    includes = [f"-I{place}" for place in (STAND_INS, "controller", "controller/wrappers")]
    command = [CPP, *STRICT, "-fsyntax-only", f"-DMACHINE={NAME}", *includes, str(SOURCE)]
    subprocess.run(command, cwd=tmp_path, check=True)


# ---- the package around it: what only a workspace would find out ----


def test_the_plugin_is_the_class_that_is_exported() -> None:
    library = ElementTree.parse(EXAMPLE / "plugin.xml").getroot()
    (plugin,) = library.findall("class")
    (exported,) = re.findall(r"PLUGINLIB_EXPORT_CLASS\(\s*([\w:]+),\s*([\w:]+)\)", SOURCE.read_text())
    assert (plugin.get("type"), plugin.get("base_class_type")) == exported
    cmake = (EXAMPLE / "CMakeLists.txt").read_text()
    assert f"add_library({library.get('path')} SHARED" in cmake
    assert "pluginlib_export_plugin_description_file(controller_interface plugin.xml)" in cmake
    managed = yaml.safe_load((EXAMPLE / "config" / "controllers.yaml").read_text())
    kind = managed["controller_manager"]["ros__parameters"]["compensation_controller"]["type"]
    assert kind == plugin.get("name")


def test_the_controllers_yaml_is_what_the_controller_takes(controller: Controller, path: Path6) -> None:
    """Its values, but for names of another machine, configure the controller; the trajectory goes to its references."""
    document = yaml.safe_load((EXAMPLE / "config" / "controllers.yaml").read_text())
    ours = document["compensation_controller"]["ros__parameters"]
    theirs = document["joint_trajectory_controller"]["ros__parameters"]
    given = {name: ours[name] for name in ("correction_rate", "tolerated_failures")}
    assert set(ours) - set(given) == {"joints", "drivers"}
    controller.run(path.nominal[:3], path.drivers[:3], given)
    assert theirs["command_joints"] == [f"compensation_controller/{joint}" for joint in ours["joints"]]
    assert theirs["joints"] == ours["joints"]
