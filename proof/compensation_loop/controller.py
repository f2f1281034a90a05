"""The controller's side: calibrate from files, write C, compile the loop, run it. It never sees a real machine."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truepose.codegen.c import generate
from truepose.errors import InputError
from truepose.identification.compensation.compensate import ideal_constants
from truepose.identification.compensation.path_table import path_rows
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predict import predictor_for
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import read_table
from truepose.models.effect_text import parse_effect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
LOOP = Path(__file__).with_name("loop.c")
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror")


def calibrated(
    drawing: Path, recording: Path, output: Path, effects: Sequence[str] | None = None
) -> tuple[Machine, list[str]]:
    """The machine as ``truepose diagnose`` improves it, by way of its file, and the effects that are in it.

    ``effects`` (as ``simulate --effect`` takes them) skips the search: these are fitted, as ``calibrate`` does.
    """
    machine = load_machine(drawing)
    rows = load_recording(machine, [recording])
    if effects is None:
        after = diagnose(machine, rows).after
    else:
        own = machine.with_effects(tuple(parse_effect(text, machine) for text in effects))
        after = calibrate(own, rows).fit
    write_calibrated(output, after, rows)
    found = load_machine(output)
    return found, [effect.label for effect in found.effects]


@dataclass(frozen=True)
class Followed:
    """One run of the loop along n ticks: ``nominal`` and ``command`` readings (n, nq), the sensor-frame poses of the tool
    that were meant (n, 4, 4), and what the loop says of its ticks."""

    nominal: Array
    command: Array
    wanted: Array
    ticks: Mapping[str, Any]


def build(machine: Machine, folder: Path, optimise: str = "-O2") -> Path:
    """The loop with the machine's C, compiled; the program's path."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise InputError("found no C compiler (cc or gcc), expected one to compile the loop with")
    drawing = machine.file.nominal if machine.file else {}
    generate(machine, folder, nominal=drawing)
    program = folder / "loop"
    sources = [str(LOOP), str(folder / f"{machine.name}_kin.c")]
    own = [f"-DMACHINE={machine.name}", f"-I{folder}"]
    subprocess.run([compiler, *FLAGS, optimise, *own, *sources, "-lm", "-o", str(program)], check=True)
    return program


def follow(
    machine: Machine,
    q: Array,
    drivers: Mapping[str, Array],
    folder: Path,
    *,
    free_running: bool = False,
    period_us: int = 1000,
    optimise: str = "-O2",
) -> Followed:
    """Nominal joints (n, nq) through the loop, one row a tick, with what was logged beside them (n,)."""
    program = build(machine, folder, optimise)
    rows = _logged(machine, q, drivers, folder / "path.csv")
    # no reading is looked at: a sensor that counts changes may count them from any row
    predictor = predictor_for(machine, replace(rows, from_row=np.arange(len(q))))
    log = predictor.z if predictor.z.shape[1] else np.empty((len(q), 0))
    columns = [*machine.mechanism.readings, *predictor.model.drivers]
    ticks, commands = folder / "ticks.csv", folder / "commands.csv"
    np.savetxt(ticks, np.hstack([q, log]), fmt="%.17g", delimiter=",", header=",".join(columns), comments="")
    options = ["--free-running"] if free_running else ["--period", str(period_us)]
    done = subprocess.run(
        [str(program), *options, str(ticks), str(commands)], check=False, capture_output=True, text=True
    )
    if done.returncode:
        raise InputError(f"{program}: {done.stderr.strip() or done.stdout.strip()}")
    ideal = ideal_constants(machine, predictor.model)
    x, _ = predictor.assemble(ideal)
    wanted, _ = predictor.poses(ideal, x)
    command = np.loadtxt(commands, delimiter=",", skiprows=1, ndmin=2)
    return Followed(q, command, wanted, json.loads(done.stdout))


def _logged(machine: Machine, q: Array, drivers: Mapping[str, Array], path: Path) -> Recording:
    """The path as a file of ``truepose compensate``, read back."""
    joints = [f"{a.reading} [{a.reading_unit}]" for a in machine.mechanism.actuators]
    columns = np.column_stack([q, *drivers.values()])
    header = ",".join([*joints, *drivers])
    np.savetxt(path, columns, fmt="%.17g", delimiter=",", header=header, comments="")
    return path_rows(machine, read_table(path))[1]


__all__ = ["Followed", "build", "calibrated", "follow"]
