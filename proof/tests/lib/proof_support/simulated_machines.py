"""The independent simulator's machines, each with a specimen and a short campaign."""

from __future__ import annotations

import numpy as np

from challenge.simulator.arm import Arm, ArmTargets
from challenge.simulator.base import Campaign, Plan, SimulatedMachine, Specimen
from challenge.simulator.stewart import Stewart

MACHINES: tuple[SimulatedMachine, ...] = (Arm(), ArmTargets(), Stewart())


def plan_for(kind: str, poses: int = 12) -> Plan:
    return Plan(poses=poses, sessions=2, moving=kind == "latency")


def drawn(machine: SimulatedMachine, kind: str = "") -> tuple[Specimen, Campaign]:
    rng = np.random.default_rng(5)
    return machine.specimen(rng), machine.campaign(plan_for(kind), rng)
