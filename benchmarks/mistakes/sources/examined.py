"""Pairs of the challenge's simulators: their own physics, a few imperfections at once, now and then MuJoCo's arms."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
import yaml

from challenge.simulator.base import Campaign, Imperfection, Kind, Plan, SimulatedMachine, Specimen
from challenge.simulator.registry import MACHINES
from challenge.simulator.writing import recording_text
from truepose.errors import TrueposeError

from ..pairs import Array, Pair

OF_ROWS = ("outliers", "fringe-miscount")
GROSS = ("wrong-constant", "frame-shift", "zero-shift")
"""What would be a mistake by itself, and steps between sessions."""


def names() -> tuple[str, ...]:
    """The challenge's machines, and those of MuJoCo whose packages are installed."""
    return (*MACHINES, *_mujoco())


def _mujoco() -> Mapping[str, type[SimulatedMachine]]:
    try:
        from challenge.mujoco.arms import machines

        return machines()
    except (TrueposeError, ImportError):
        return {}


def examined(name: str, rng: np.random.Generator, *, effects: int = 1, still: bool = False) -> Pair:
    """A pair of the machine ``name``; ``still``: one joint never moves. Raises ValueError where no campaign was found."""
    machine = MACHINES[name]() if name in MACHINES else _mujoco()[name]()
    specimen = machine.specimen(rng)
    for _ in range(20):
        c = _campaign(machine, rng)
        if still:
            c = _held(c, machine, rng)
        thrown = _imperfections(machine, rng, effects)
        try:
            exact = machine.measure(specimen, thrown, c)
        except (ValueError, ArithmeticError):  # no equilibrium with these, or poses out of reach
            continue
        return _pair(machine, specimen, c, exact, rng, not thrown)
    raise ValueError(f"{name}: found no campaign that could be measured in 20")


def _campaign(machine: SimulatedMachine, rng: np.random.Generator) -> Campaign:
    """Visits from one side; a quarter are read from both."""
    plan = Plan(
        poses=int(rng.integers(30, 46)),
        both_sides=bool(rng.random() < 0.25),
        loads=bool(rng.random() < 0.5),
        heat=bool(rng.random() < 0.5),
        held_out=0.0 if rng.random() < 0.5 else 0.2,
    )
    return machine.campaign(plan, rng)


def _held(c: Campaign, machine: SimulatedMachine, rng: np.random.Generator) -> Campaign:
    q = c.q.copy()
    k = int(rng.integers(q.shape[1]))
    q[:, k] = q[0, k]
    return replace(c, q=q)


def _imperfections(
    machine: SimulatedMachine, rng: np.random.Generator, count: int
) -> tuple[Imperfection, ...]:
    known: list[Kind] = [k for k in machine.kinds() if k.slug not in (*OF_ROWS, *GROSS)]
    known = [k for k in known if not any(need.startswith("velocity") for need in k.needs)]
    out = []
    for k in rng.permutation(len(known))[:count]:
        kind = known[int(k)]
        place = kind.places[int(rng.integers(len(kind.places)))]
        size = kind.typical * float(np.exp(rng.uniform(np.log(0.5), np.log(3.0))))
        out.append(Imperfection(kind.name, place, size, dict(machine.shape(kind.name, place, rng))))
    return tuple(out)


def _pair(
    machine: SimulatedMachine,
    specimen: Specimen,
    c: Campaign,
    exact: Array,
    rng: np.random.Generator,
    plain: bool,
) -> Pair:
    del specimen
    observed = machine.noisy(exact, c, rng)
    table = pd.read_csv(io.StringIO(recording_text(machine, c, observed)))
    kinds = dict(
        zip(machine.readings, ("revolute" if r else "prismatic" for r in machine.revolute), strict=True)
    )
    document = yaml.safe_load(machine.machine_text())
    return Pair(machine.name, document, table, kinds, plain=plain)
