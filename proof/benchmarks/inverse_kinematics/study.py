"""The parts of the study of one arm: the generated C and its peers on the same problems, each one a table's rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from truepose.codegen.printer import Real

from . import arms, forward, generated, newton, peers
from .outcome import Kind, Row, Timing
from .problems import ProblemFiles, Problems, anywhere, near, save

Array = NDArray[np.float64]
LM = {"method": "chan", "k": 0.1}
"""The fastest of ik_LM's methods and gains that solve everything here."""


@dataclass(frozen=True)
class Options:
    """How much, where and with whom: ``poses`` random ones, ``core`` to run on, interpreter of the Python peers."""

    poses: int
    warm: int
    branches: int
    repeats: int
    rounds: int
    real: Real
    core: int | None
    folder: Path
    peers: peers.Peers
    include: Sequence[Path] | str
    """Header folders of pinocchio, or why there are none."""


@dataclass(frozen=True)
class Bench:
    """One arm with what was compiled for it, by flags; ``newton`` is empty without pinocchio's headers."""

    arm: arms.Arm
    programs: dict[tuple[str, ...], generated.Program]
    newton: dict[tuple[str, ...], newton.Newton]
    chain: Path
    library: Path
    tolerance: tuple[float, float]
    """What counts as solved by the generated C: mm, rad. 1e-6 and 1e-9 in double."""

    @property
    def source(self) -> generated.Source:
        return self.programs[generated.NATIVE].source

    def row(
        self,
        solver: str,
        timing: Timing,
        problems: Problems,
        flags: Sequence[str] = (),
        kind: Kind = Kind.PEER,
    ) -> Row:
        """A row from output of a code (ours) or success, then joints; solutions beyond ranges are remarked.

        Ours must be in the ranges as they are, a peer's after whole turns.
        """
        codes, joints = timing.output[:, 0].astype(int), timing.output[:, 1:]
        ours = kind is not Kind.PEER
        close = self.tolerance if ours else forward.CLOSE
        met = forward.solved(self.arm, joints, problems.targets, *close)
        low, high = self.arm.ranges[:, 0] - close[1], self.arm.ranges[:, 1] + close[1]
        turned = joints if ours else low + np.mod(joints - low, 2 * np.pi)
        beyond = met & np.any((turned < low) | (turned > high), axis=1)
        remarks = [
            f"{np.sum(codes == code)} with code {code}" for code in np.unique(codes[codes != 0]) if ours
        ]
        remarks += [f"{100 * np.mean(beyond):.3g} % beyond a range"] if np.any(beyond) else []
        return Row(solver, timing.seconds, float(np.mean(met)), kind, " ".join(flags), ", ".join(remarks))


def newton_programs(options: Options) -> dict[tuple[str, ...], newton.Newton]:
    """pinocchio's program with each set of flags; empty without headers."""
    if isinstance(options.include, str):
        return {}
    kinds = (generated.NATIVE, generated.PLAIN)
    return {flags: newton.build(options.include, options.folder, flags) for flags in kinds}


def bench(drawing: arms.Drawing, options: Options, programs: dict[tuple[str, ...], newton.Newton]) -> Bench:
    """Write the arm's machine file and C, and compile both."""
    machine = arms.write(drawing, options.folder)
    arm = arms.arm_of(drawing, arms.specimen(drawing))
    source = generated.write(machine, options.folder, options.real)
    built = {flags: generated.build(source, flags) for flags in (generated.NATIVE, generated.PLAIN)}
    library = generated.library(source)
    chain = newton.chain(arm, options.folder)
    return Bench(arm, built, programs, chain, library, tolerance(arm, options.real))


def tolerance(arm: arms.Arm, real: Real) -> tuple[float, float]:
    """mm and rad within which the C of a type promises the pose."""
    if real == "double":
        return forward.CLOSE
    reach = float(np.linalg.norm(forward.placements(arm)[:, :3, 3], axis=1).sum())
    return 2e-6 * reach, 2e-6


def warm(b: Bench, options: Options) -> list[Row]:
    """A guess one degree away in every joint, one pose a call."""
    problems = near(b.arm, options.warm)
    files = save(problems, options.folder, f"{b.arm.name}_near")
    rows = _ours(b, options, problems, files, options.repeats)
    rows += _ours(b, options, problems, files, options.repeats, "batch") if b.source.batch else []
    return rows + _newton(b, options, problems, files, ("clik", "lean", "leaner"), options.repeats)


def python(b: Bench, options: Options) -> list[Row]:
    """The same from Python, one call a pose."""
    problems = near(b.arm, min(options.warm, 2000))
    timing = generated.from_python(b.source, b.library, problems, options.repeats)
    ours = b.row("truepose through ctypes", timing, problems, generated.NATIVE, Kind.OURS)
    return [ours, *_levenberg_marquardt(b, options, problems, 3)]


def random(b: Bench, options: Options) -> list[Row]:
    """Solutions and guesses anywhere in the ranges, which of the peers only those that say so keep."""
    problems = anywhere(b.arm, options.poses)
    files = save(problems, options.folder, f"{b.arm.name}_anywhere")
    rows = _ours(b, options, problems, files, 3)
    rows += _newton(b, options, problems, files, ("clik", "lean", "restarts", "ranges"), 3)
    fewer = problems.head(min(options.poses, 10_000))
    for limited in (False, True):
        rows += _levenberg_marquardt(b, options, fewer, 1, limited)
    return rows


def _ours(
    b: Bench, options: Options, problems: Problems, files: ProblemFiles, repeats: int, mode: str = "one"
) -> list[Row]:
    title, kind = ("truepose C", Kind.OURS) if mode == "one" else ("truepose C, all in one call", Kind.BATCH)
    rows = []
    for flags, program in b.programs.items():
        timing = generated.timed(program, mode, files, repeats, options.core)
        rows.append(b.row(title, timing, problems, flags, kind))
    return rows


def _newton(
    b: Bench, options: Options, problems: Problems, files: ProblemFiles, modes: Sequence[str], repeats: int
) -> list[Row]:
    rows = []
    for flags, program in b.newton.items():
        for mode in modes:
            timing = newton.timed(program, mode, b.chain, files, repeats, options.core)
            rows.append(b.row(f"pinocchio C++, {newton.MODES[mode]}", timing, problems, flags))
    return rows


def _levenberg_marquardt(
    b: Bench, options: Options, problems: Problems, repeats: int, limited: bool = False
) -> list[Row]:
    if "roboticstoolbox-python" not in options.peers.versions:
        return []
    inputs = {**in_metres(b, problems), "guesses": problems.guesses, "repeats": repeats, **LM}
    inputs |= {"ranges": b.arm.ranges, "limited": limited}
    timing = peers.timed(options.peers, "roboticstoolbox_lm", inputs, options.folder, options.core)
    title = f"roboticstoolbox ik_LM from Python ({LM['method']}, k = {LM['k']})"
    return [b.row(title + (", joint_limits" if limited else ""), timing, problems)]


def in_metres(b: Bench, problems: Problems) -> dict[str, object]:
    """Placements and targets with lengths in metres, as the Python peers take them."""
    placements, targets = forward.placements(b.arm), problems.targets.copy()
    placements[:, :3, 3] *= 1e-3
    targets[:, :3, 3] *= 1e-3
    return {"placements": placements, "targets": targets}
