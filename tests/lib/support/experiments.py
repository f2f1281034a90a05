"""Experiments that tell explanations apart, planned on an arm and on a telescope."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from support import MACHINES
from truepose.identification.leaves.planning.discriminate.experiment import Experiment, discriminate
from truepose.identification.leaves.planning.discriminate.factors import Class, explanation, read_offer
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine, Mass

Array = NDArray[np.float64]
LEGS = "+".join(f"leg{k}" for k in range(1, 7))
COMPLIANT = f"leg-compliance@{LEGS}:c=1e-3"
BENT = "platform-deformation@platform:kappa=0.01,form=0"
YIELDING, UNEVEN = "joint-compliance@q2:c=1e-5", "transmission-error@q2:order=1,a=1e-4"


@cache
def arm() -> Machine:
    return load_machine(MACHINES / "serial.yaml")


@cache
def telescope() -> Machine:
    """With a heavy mirror, and a payload that may be stepped."""
    machine = load_machine(MACHINES / "pus.yaml")
    flange = machine.mechanism.flange
    masses = (
        Mass("mirror", 15.0, (10.0, 20.0, 40.0), flange),
        Mass("payload", 0.0, (0.0, 12.0, 60.0), "tool"),
    )
    return replace(machine, gravity=(0.0, 0.0, -9.80665), masses=masses)


def poses(machine: Machine, n: int, seed: int = 0) -> Array:
    low, high = np.array([a.range for a in machine.mechanism.actuators], dtype=float).T
    return np.random.default_rng(seed).uniform(low, high, (n, len(low)))


def planned_on(
    machine: Machine, *texts: str, n: int = 10, payload: str = "", vary: tuple[str, ...] = ()
) -> Experiment:
    wanted = Class(tuple(explanation(text, machine) for text in texts))
    offer = read_offer(machine, payload, vary)
    return discriminate(machine, n, wanted, offer=offer, candidates=poses(machine, 30))


@cache
def planned(name: str, *texts: str, n: int = 10, payload: str = "", vary: tuple[str, ...] = ()) -> Experiment:
    """The same on a machine by its name, once for all tests."""
    machine = {"arm": arm, "telescope": telescope}[name]()
    return planned_on(machine, *texts, n=n, payload=payload, vary=vary)
