"""Calibrates a simulated real machine, runs the loop at 1 kHz, and prints how far off the machine stands."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truepose.models.machine.machine import Machine

from . import paths
from .controller import Followed, calibrated, follow
from .real_machines import Errors, Nanopositioner, Polisher, RealMachine, Telescope

Array = NDArray[np.float64]
PERIOD = 0.001
"""s."""


@dataclass(frozen=True)
class Case:
    """A real machine, the path planned for it, how many ticks, and every how many its position is looked at."""

    real: RealMachine
    planner: paths.Planner
    ticks: int
    looked: int
    effects: Sequence[str] | None = None


CASES: Mapping[str, Case] = {
    "nanopositioner": Case(Nanopositioner(), paths.about_the_spot, 10_000, 1, effects=()),
    "telescope": Case(Telescope(), paths.pointing, 10_000, 20),
    "polisher": Case(Polisher(), paths.raster, 24_000, 10),
}
Ways = Mapping[str, Errors]
"""Errors by what the commands know."""


def run(case: Case, folder: Path, **loop: Any) -> tuple[Followed, Ways]:
    """The whole chain: recording, calibration, C, loop, and the real machine moved with either commands.

    ``loop`` are the options of ``follow``.
    """
    drawing, recording = case.real.write(folder)
    machine, _ = calibrated(drawing, recording, folder / "calibrated.yaml", case.effects)
    q = case.planner(machine, case.ticks)
    seconds = np.arange(case.ticks) * np.float64(PERIOD)
    drivers = case.real.drivers(q, seconds)
    done = follow(machine, q, drivers, folder, **loop)
    at = slice(None, None, case.looked)
    ways = {"nominal": done.nominal, **_zeroed(machine, done.nominal), "compensated": done.command}
    errors = {
        name: case.real.errors(command[at], done.wanted[at], seconds[at]) for name, command in ways.items()
    }
    return done, errors


def _zeroed(machine: Machine, nominal: Array) -> Mapping[str, Array]:
    """Commands that know the encoders' offsets and nothing else, where they are the bulk of the errors."""
    value = {parameter.name: parameter.nominal for parameter in machine.mechanism.parameters}
    names = [f"{reading}.offset" for reading in machine.mechanism.readings]
    if not all(name in value for name in names):
        return {}
    return {"encoder offsets only": nominal - np.array([value[name] for name in names])}


def lines(name: str, case: Case, done: Followed, errors: Ways) -> list[str]:
    """The result as a table, and what the loop says of its ticks."""
    what = list(errors["nominal"])
    out = [
        f"{name}: {case.ticks} ticks",
        "",
        "| commands | " + " | ".join(f"{w}: rms, mean, max" for w in what) + " |",
    ]
    out.append("|---" * (1 + len(what)) + "|")
    for way, found in errors.items():
        cells = [
            f"{np.sqrt(np.mean(found[w] ** 2)):.4g}, {np.mean(found[w]):.4g}, {np.max(found[w]):.4g}"
            for w in what
        ]
        out.append(f"| {way} | " + " | ".join(cells) + " |")
    took = done.ticks["compute_us"]
    out += [
        "",
        f"a tick computes {took['mean']:.1f} us (mean), {took['p99.9']:.1f} (99.9 %), {took['max']:.1f} (max)",
    ]
    if "missed" in done.ticks:
        out[-1] += f"; missed {done.ticks['missed']} of {done.ticks['ticks']} deadlines of "
        out[-1] += f"{done.ticks['period_us']:.0f} us, latest start {done.ticks['latest_start_us']:.0f} us"
    return out


def main(arguments: Sequence[str] | None = None, say: Callable[[str], object] = print) -> None:
    """Every machine named, one after the other; ``say`` takes the text."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("machines", nargs="*", metavar="|".join(CASES), help="which (default: all)")
    parser.add_argument("-o", type=Path, help="folder to keep recording, C, path and commands in")
    parser.add_argument("--free-running", action="store_true", help="as fast as it goes, without a clock")
    parser.add_argument("--period-us", type=int, default=1000, help="of the loop (default: 1000)")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.machines if name not in CASES]
    if unknown:
        parser.error(f"found {unknown[0]!r}, expected some of {', '.join(CASES)}")
    for name in options.machines or CASES:
        with ExitStack() as stack:
            root = options.o or Path(stack.enter_context(TemporaryDirectory()))
            folder = root / name
            folder.mkdir(parents=True, exist_ok=True)
            done, errors = run(
                CASES[name], folder, free_running=options.free_running, period_us=options.period_us
            )
        say("\n".join([*lines(name, CASES[name], done, errors), ""]))


if __name__ == "__main__":
    main()
