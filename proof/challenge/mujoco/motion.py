"""A campaign driven in MuJoCo: where the tool stands when all is at rest.

Without gaps and friction rest is found by statics: springs against what MuJoCo says gravity does. Otherwise every row is
driven: from behind its goal at constant speed, then waiting, with all states kept from row to row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from challenge.mujoco.mjcf import COUPLED, STEP, Build, Yielding, mjcf

Array = NDArray[np.float64]
MOVING, WAITING = 60, 170
"""Steps of the last way to a pose, and at rest before it is read."""
ROUNDS, SETTLED = 60, 1e-14
LOST = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


@dataclass(frozen=True)
class Way:
    """Motor angles of each row (n, nq) rad, where the last move to it began (n, nq), payload (n,) kg."""

    goal: Array
    start: Array
    payload: Array

    def __len__(self) -> int:
        return len(self.goal)


def driven(build: Build, yielding: Yielding, way: Way) -> Array:
    """(n, 4, 4) tool in frame 0, m, in every row in order. Raises ValueError where nothing comes to rest."""
    plants = {float(kg): _Plant(build, yielding, float(kg)) for kg in np.unique(way.payload)}
    out, state = np.zeros((len(way), 4, 4)), np.zeros(0)
    for row in range(len(way)):
        plant = plants[float(way.payload[row])]
        if yielding.remembers:
            state = plant.arrive(way.start[row], way.goal[row], state)
        else:
            plant.balance(way.goal[row])
        out[row] = plant.tool
    return out


class _Plant:
    """A compiled model under one payload."""

    def __init__(self, build: Build, yielding: Yielding, payload: float) -> None:
        masses = dict(build.masses)
        masses["payload"] = (payload, masses["payload"][1])
        self.model: Any = mujoco.MjModel.from_xml_string(mjcf(replace(build, masses=masses), yielding))
        self.data: Any = mujoco.MjData(self.model)
        names = [self.model.joint(j).name for j in range(self.model.njnt)]
        motors = [f"q{k + 1}" for k in range(len(build.rows))]
        self.motors = np.array([names.index(name) for name in motors])
        self.loads = np.array([j for j, name in enumerate(names) if name not in motors], dtype=int)
        fed = [f"q{k + 1}.spring" for k in yielding.fed]
        self.fed = np.array([names.index(name) for name in fed], dtype=int)
        tied = np.array([".by." in names[j] for j in self.loads], dtype=bool)
        own = np.array([float(np.ravel(self.model.jnt_stiffness[j])[0]) for j in self.loads])
        self.stiffness = np.where(tied, COUPLED, own)
        self.site = self.model.site("tool").id

    @property
    def tool(self) -> Array:
        """(4, 4) of the site as it was computed last."""
        out = np.eye(4)
        out[:3, :3] = self.data.site_xmat[self.site].reshape(3, 3)
        out[:3, 3] = self.data.site_xpos[self.site]
        return out

    def balance(self, goal: Array) -> None:
        """Motors at a goal (nq,), springs where they bear the weight."""
        model, data = self.model, self.data
        data.qvel[:] = 0.0
        data.qpos[self.motors], data.qpos[self.loads] = goal, 0.0
        for _ in range(ROUNDS):
            mujoco.mj_fwdPosition(model, data)
            if not len(self.loads):
                return
            mujoco.mj_fwdVelocity(model, data)
            missing = data.qfrc_passive[self.loads] - data.qfrc_bias[self.loads]
            step = missing / self.stiffness
            if np.max(np.abs(step)) < SETTLED:
                return
            data.qpos[self.loads] += step
        raise ValueError("found no rest under gravity; are the springs too soft?")

    def arrive(self, start: Array, goal: Array, state: Array) -> Array:
        """Drive to a goal (nq,), wait, and give back the states behind the motors, as ``state`` was given."""
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        if len(state):
            data.qpos[self.loads] = state
        self._feed(goal)
        data.qpos[self.motors] = start
        data.qvel[self.motors] = (goal - start) / (MOVING * STEP)
        mujoco.mj_step(model, data, MOVING)
        data.qpos[self.motors], data.qvel[self.motors] = goal, 0.0
        mujoco.mj_step(model, data, WAITING)
        data.qpos[self.motors] = goal
        mujoco.mj_fwdPosition(model, data)
        # MuJoCo starts anew, at zero, where it has lost its way
        if any(data.warning[lost].number for lost in LOST) or not np.all(np.isfinite(data.qpos)):
            raise ValueError("found no rest in the motion; are the springs too soft?")
        return np.array(data.qpos[self.loads])

    def _feed(self, goal: Array) -> None:
        """Drives that bear the weight themselves push by what gravity does at the goal."""
        model, data = self.model, self.data
        if not len(self.fed):
            return
        data.qpos[self.motors] = goal
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        data.qfrc_applied[self.fed] = data.qfrc_bias[self.fed]


__all__ = ["Way", "driven"]
