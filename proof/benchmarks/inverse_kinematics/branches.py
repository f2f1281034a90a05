"""All inverses of a pose: NAME_ik_all against ssik, each solution checked, each set searched for the other's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import forward, generated, peers
from .arms import Arm
from .outcome import Kind, Row
from .problems import Problems, anywhere, save
from .study import Bench, Options, in_metres

Array = NDArray[np.float64]
SAME = 1e-4
"""Two solutions are one where every joint agrees to this, modulo whole turns; rad. Next to a double root two solvers
that both meet the pose to 1e-9 may stand the root of that apart."""


@dataclass(frozen=True)
class Branches:
    """Solutions (m, joints) that meet their pose and fit the ranges, the pose (m,) of each, and how many did not meet it."""

    joints: Array
    pose: NDArray[np.int_]
    wrong: int


def rows(b: Bench, options: Options) -> list[Row]:
    """Time of each solver; the remark says what one found and the other did not."""
    problems = anywhere(b.arm, options.branches, seed=3)
    out: list[Row] = []
    ours = None
    if b.source.branches:
        files = save(problems, options.folder, f"{b.arm.name}_all")
        for flags, program in b.programs.items():
            timing = generated.timed(program, "all", files, 3, options.core)
            ours = kept(b.arm, timing.output[:, 1], timing.output[:, 2:], problems.targets)
            note = _found(ours, problems)
            out.append(Row("truepose C", timing.seconds, kind=Kind.OURS, flags=" ".join(flags), note=note))
    return out + _ssik(b, options, problems, ours)


def _ssik(b: Bench, options: Options, problems: Problems, ours: Branches | None) -> list[Row]:
    out = []
    for refine in (0, 1) if "ssik" in options.peers.versions else ():
        inputs = {**in_metres(b, problems), "refine": refine}
        timing = peers.timed(options.peers, "ssik_branches", inputs, options.folder, options.core)
        theirs = kept(b.arm, timing.output[:, 0], timing.output[:, 1:], problems.targets)
        note = _found(theirs, problems)
        if ours is not None:
            note += f"; truepose lacks {unmatched(theirs, ours)} of them; of truepose's it lacks {unmatched(ours, theirs)}"
        title = "ssik from Python" + (", allow_refinement" if refine else "")
        out.append(Row(title, timing.seconds, note=note))
    return out


def _found(branches: Branches, problems: Problems) -> str:
    poses = len(problems.targets)
    without = poses - len(np.unique(branches.pose))
    return f"{len(branches.joints) / poses:.4f} a pose, {branches.wrong} wrong, {without} poses without any"


def kept(arm: Arm, counts: Array, joints: Array, targets: Array) -> Branches:
    """Solutions as rows: those that meet their targets (n, 4, 4) and can stand in the ranges, turned into them."""
    n = len(arm.joints)
    listed = joints.reshape(len(targets), -1, n)
    pose, place = np.nonzero(np.arange(listed.shape[1]) < counts[:, None])
    flat = listed[pose, place]
    met = forward.solved(arm, flat, targets[pose])
    low, high = arm.ranges[:, 0] - forward.CLOSE[1], arm.ranges[:, 1] + forward.CLOSE[1]
    inside = low + np.mod(flat - low, 2 * np.pi)
    fits = met & np.all(inside <= high, axis=1)
    return Branches(inside[fits], pose[fits], int(np.sum(~met)))


def unmatched(some: Branches, others: Branches) -> int:
    """How many of ``some`` have none of ``others`` at the same pose next to them."""
    starts = np.searchsorted(
        others.pose, np.arange(max(some.pose.max(initial=0), others.pose.max(initial=0)) + 2)
    )
    missing = 0
    for q, pose in zip(some.joints, some.pose, strict=True):
        near = others.joints[starts[pose] : starts[pose + 1]] - q
        apart = np.abs(near - 2 * np.pi * np.round(near / (2 * np.pi)))
        missing += not np.any(np.all(apart < SAME, axis=1))
    return missing
