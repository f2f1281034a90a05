"""What machine files of every kind are read as: constants, tolerances, joints, sensors, and what each constant moves.

A change of it shows as a change of ``tests/golden_machines``. After one that is meant:

    pytest tests/kernel/models/test_golden_machines.py --update-golden

writes them anew; what then differs is for the reviewer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from support import MACHINES, TESTS
from support.effect_machines import READINGS, read_machines
from support.effects import Solved
from support.golden_pages import as_committed
from truepose.models.load import load_machine
from truepose.models.machine.closure import home_readings
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

NAMES = (*READINGS, *(f"{path.stem} file" for path in sorted(MACHINES.glob("*.yaml"))))


def stated(machine: Machine) -> Iterator[str]:
    """Lines on what the file says, in the program's units."""
    for a in machine.mechanism.actuators:
        ends = "free" if a.range is None else " to ".join(f"{end:.6e}" for end in a.range)
        yield f"joint {a.reading} [{a.reading_unit}] drives {a.drives} [{a.unit}], {ends}"
    for sensor in machine.sensors:
        columns = ", ".join(f"{name} [{unit}]" for name, unit in sensor.columns.items())
        yield f"sensor {sensor.type}: {columns}; labels {', '.join(sensor.label_columns)}"
        for channel in sensor.channels:
            yield f"  {channel.kind}: {channel.sigma:.6e} {channel.unit}"
    for mass in machine.masses:
        yield f"mass {mass.name} {mass.kg:.6e} kg on {mass.body} at {' '.join(f'{v:.6e}' for v in mass.com)}"
    yield f"gravity {machine.gravity}; drivers {', '.join(machine.drivers)}"
    yield from (
        f"note: {note.replace(str(machine.file.path) if machine.file else '', 'FILE')}"
        for note in machine.notes
    )


def moved(machine: Machine, q: Sequence[float]) -> Iterator[str]:
    """Lines on the constants, and what each moves at the tool and in the readings, in its own unit."""
    solved = Solved(symbolic_model(machine), q)
    yield "pose: " + " ".join(f"{v:.3e}" if abs(v) > 1e-9 else "0" for v in solved.pose[:3].ravel())
    yield "reads: " + " ".join(f"{v:.3e}" if abs(v) > 1e-9 else "0" for v in solved.readings)
    for p in machine.parameters:
        column = solved.jacobian[:, solved.model.names.index(p.name)]
        told = " ".join(
            f"{v:.3e}" if abs(v) > max(1e-7 * np.abs(column).max(), 1e-11) else "0" for v in column
        )
        yield f"{p.name} [{p.unit}] {p.nominal:.6e} +- {p.tolerance:.6e}{'' if p.free else ' held'}: {told}"


@pytest.mark.parametrize("name", NAMES)
def test_what_a_machine_file_is_read_as_is_as_committed(
    name: str, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> None:
    """Results of last year were fitted with it."""
    folder = tmp_path_factory.getbasetemp() / "golden_machines"
    if name in READINGS:
        machine = read_machines(folder)[name]
        q = READINGS[name]
    else:
        machine = load_machine(MACHINES / f"{name.removesuffix(' file')}.yaml")
        q = home_readings(machine.mechanism).tolist()
    update = bool(request.config.getoption("--update-golden"))
    made = [*stated(machine), *moved(machine, q)]
    as_committed(TESTS / "golden_machines" / f"{name.replace(' ', '_')}.txt", made, update=update)
