"""The example's controller of ros2_control, compiled with the stand-in for a controller manager, and run from here."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from support.rail_arm import DRIVERS

Array = NDArray[np.float64]
TO_ROS = np.array([1e-3, 1.0, 1.0, 1.0, 1.0, 1.0])
"""mm and rad to m and rad."""
AT_ONCE = {"correction_rate": 1e9}
"""No limit to how fast the correction changes."""


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
        text = [f"#drivers {' '.join(DRIVERS)}", *(" ".join(f"{v:.17g}" for v in row) for row in rows)]
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
