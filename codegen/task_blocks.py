"""What the generated C knows of a task: which rows of a pose count, and how far the tool is turned from its goal."""

from __future__ import annotations

from typing import Any

import casadi as ca

from truepose.codegen.layout import Layout
from truepose.codegen.loop_blocks import Writer
from truepose.models import lie
from truepose.models.machine.singular import CALM, FARTHEST, NOTHING
from truepose.models.task import Task


def write_turns(writer: Writer, task: Task) -> None:
    """Write the function of the turns that a task counts, and of their rates by the turn in the base frame."""
    target, pose, w = ca.SX.sym("target", 12), ca.SX.sym("T", 12), ca.SX.sym("w", 3)
    goal, rotation = (ca.reshape(lines, 4, 3).T[:, :3] for lines in (target, pose))
    left = task.turns(goal, rotation + lie.skew(w) @ rotation)
    at = [ca.substitute(v, w, ca.SX.zeros(3)) for v in (-left, ca.jacobian(left, w).T)]
    e, S = writer.graph.add({"target": target, "T": pose}, [ca.densify(v) for v in at])
    targets = [(f"e[{k}]", node) for k, node in enumerate(e)] + [
        (f"S[{k}]", node) for k, node in enumerate(S)
    ]
    title = "Turns that take T to the target about the tool's axes, about rad, and their rates by a turn in the base frame."
    writer.function(title, "turns_left", (("target", "T"), ("e", "S")), targets)


def easing_context(layout: Layout, *, single: bool) -> dict[str, Any] | None:
    """Return what commands next to singular poses read; None where no joint has to swing for a turn."""
    if not layout.free:
        return None
    return {
        "free": layout.free,
        "holders": [k for k in range(len(layout.near)) if k not in layout.free],
        "calm": CALM,
        "farthest": FARTHEST,
        "nothing": max(NOTHING, layout.share * layout.rotation),
        "steps": 12,
        "settled": 1e-6 if single else 1e-12,
    }


def task_context(task: Task) -> dict[str, Any]:
    """Return what the templates read: ``skip`` rows of six do not count, ``along`` and ``about`` are axes.

    ``swings``: a turn may ask a joint to move far where the position alone would not.
    """
    return {
        "partial": not task.is_whole,
        "skip": 6 - len(task.rows),
        "along": task.along,
        "about": task.about,
        "axis": task.axis,
        "swings": task.position is not None,
        "words": task.words,
    }
