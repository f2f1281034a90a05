"""What every candidate shifts, row by row, as one compiled function."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from truepose.arrays import Array, Index
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect, Site
from truepose.models.machine.kinematics import driver_default
from truepose.models.machine.machine import Machine
from truepose.models.machine.states import state_names


class ShiftFunction:
    """All candidates' shifts by their coefficients (in units of scale), as one function of a row."""

    def __init__(self, machine: Machine, recording: Recording, candidates: Sequence[PlacedEffect]) -> None:
        self._machine, self._recording = machine, recording
        self._names = [*(p.name for p in machine.parameters), *machine.ports]
        self.drivers = tuple(dict.fromkeys(name for c in candidates for name in c.drivers))
        q = {name: ca.SX.sym(name) for name in machine.mechanism.readings}
        z = {name: ca.SX.sym(name) for name in self.drivers}
        values = {name: ca.SX.sym(name) for name in self._names}
        self._loads = [f"{case}{name}" for case in machine.load_cases for name in self._names]
        loads = {name: ca.SX.sym(f"load.{name}") for name in self._loads}
        self._states = state_names(machine)
        states = {name: ca.SX.sym(name) for name in self._states}
        outputs, layout, offset = [], [], 0
        for candidate in candidates:
            c = {item.name: ca.SX.sym(item.name) for item in candidate.coefficients}
            site = Site(machine, candidate.place, candidate.settings_map, c, q, z, values, loads, states)
            shifts = candidate.effect.shifts(site)
            stacked, symbols = ca.vertcat(*shifts.values()), ca.vertcat(*c.values())
            local = ca.substitute(ca.jacobian(stacked, symbols), symbols, ca.SX.zeros(len(c)))
            local = local @ ca.diag(ca.DM([item.scale for item in candidate.coefficients]))
            outputs.append(ca.vec(ca.densify(local)))
            size = local.numel()
            layout.append(([site.checked(port, candidate) for port in shifts], slice(offset, offset + size)))
            offset += size
        self.layout: list[tuple[list[str], slice]] = layout
        groups = (q, z, values, loads, states)
        inputs = [ca.vertcat(*group.values()) if group else ca.SX(0, 1) for group in groups]
        together = ca.vertcat(*outputs) if outputs else ca.SX(0, 1)
        self._function = BatchFunction("shifts", inputs, [together])

    def __call__(
        self, names: Sequence[str], p: Array, loads: Mapping[str, Array], states: Mapping[str, Array],
        rows: Index,
    ) -> Array:  # fmt: skip
        """(k, total) shift derivatives for some rows; loads and states (k,) are theirs."""
        at = {name: k for k, name in enumerate(names)}
        which = [at[name] for name in self._names]
        rec = self._recording
        z = np.empty((len(rows), len(self.drivers)))
        for k, name in enumerate(self.drivers):
            recorded = rec.driver(name)
            z[:, k] = driver_default(self._machine, name) if recorded is None else recorded[rows]
        force, state = (
            np.column_stack([np.zeros((len(rows), 0)), *(group[name] for name in wanted)])
            for group, wanted in ((loads, self._loads), (states, self._states))
        )
        return self._function(rec.positions[rows], z, p[which], force, state)[0][..., 0]
