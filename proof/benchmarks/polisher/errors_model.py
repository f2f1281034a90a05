"""The error model both ways, screws (appendix A) and exact differentiation, and the count of its source errors."""

from __future__ import annotations

import numpy as np

from truepose.identification.prediction.predictor import Predictor
from truepose.models.machine.machine import Machine

from . import layers, regression
from . import workspace as ws
from .montecarlo import Size
from .motions import Array
from .screws import screw_model
from .source_errors import LIMBS, MIDDLE

CONFIGURATIONS, SEED = 200, 7
COUNT_HEAD = ("where", "joints", "source errors")
AGREEMENT_HEAD = ("machine", "parameters", "configurations", "largest relative difference of a column")


def count_rows() -> list[list[str]]:
    """Encoders, then six and five a joint: the paper's own definitions add up to 150."""
    errors = regression.errors()
    rows = [["encoders", "3 limbs, 3 wrist joints", str(sum(e.component == "offset" for e in errors))]]
    for limb in LIMBS:
        own = sum(e.limb == limb and e.component != "offset" for e in errors)
        rows.append([f"limb {limb} (UPS)", "6 + 6 x 5", str(own)])
    middle = [e for e in errors if e.limb == MIDDLE and e.component != "offset"]
    rows.append(["limb 4, UP", "6 + 3 x 5", str(sum(e.link <= 3 for e in middle))])
    rows.append(["limb 4, wrist", "3 x 5", str(sum(e.link > 3 for e in middle))])
    return [*rows, ["together", "", str(len(errors))]]


def agreement_rows() -> list[list[str]]:
    """At random configurations of robots drawn from their tolerances."""
    rows = []
    for name, machine in layers.machines(Size(0.05, 0.02)).items():
        difference = agreement(machine)
        rows.append(
            [name, str(len(machine.mechanism.parameters) + 12), str(CONFIGURATIONS), f"{difference:.1e}"]
        )
    return rows


def agreement(machine: Machine, count: int = CONFIGURATIONS, seed: int = SEED) -> float:
    """Largest difference of a parameter's twist between both ways, over the twist's size (mm, 1000 mm rad)."""
    rng = np.random.default_rng(seed)
    predictor = Predictor(machine, regression.recording(configurations(rng, count), None, machine))
    sigma = np.array([parameter.tolerance for parameter in machine.parameters])
    p = predictor.model.p_home + sigma * rng.normal(size=len(sigma))
    x, good = predictor.assemble(p)
    if not good.all():
        raise ValueError("found a configuration where the robot cannot be assembled")
    _, exact = predictor.twists(p, x)
    scale = np.array([1.0] * 3 + [1000.0] * 3)[:, None]
    away = np.linalg.norm((screw_model(machine, predictor.q, x, p).error - exact) * scale, axis=1)
    size = np.linalg.norm(exact * scale, axis=1)
    return float(np.max(away / np.maximum(size, 1.0)))


def configurations(rng: np.random.Generator, count: int) -> Array:
    """(count, 6) joints for tool poses all over the workspace, tilted by up to 15 deg."""
    at = rng.uniform(-0.5, 0.5, (count, 3)) * [ws.WIDTH, ws.WIDTH, ws.HEIGHT] + [0.0, 0.0, ws.HEIGHT / 2]
    turns = np.array([ws.rotation_y(angle) for angle in rng.uniform(-0.26, 0.26, count)])
    out = ws.joints(ws.tool_poses(0.7 * at, turns))
    out[:, 3:] += rng.uniform(-0.1, 0.1, (count, 3))
    return out
