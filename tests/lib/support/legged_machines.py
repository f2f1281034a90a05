"""Hexapods whose legs are solved one by one in generated C: in closed form, by Newton's method, or with their forces."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from support.generated_c import LEVEL, Built, compile_library
from support.generated_machines import HEAD, RAILS, TURNS
from truepose.arrays import Array
from truepose.codegen.c import generate
from truepose.codegen.printer import Real
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model

_BARE_RAILS = RAILS.split("masses:")[0].replace("range: [-20", "screw_pitch: 5, range: [-20")
_BACKLASH = "  - {effect: backlash, place: [rho4], parameters: {b: {value: 0.02, unit: mm}}}\n"
_HEAT = "  - {effect: thermal-expansion, place: [leg3], parameters: {alpha: {value: 1.2e-5, unit: 1/K}}}\n"
_SCREW = """  - {effect: screw-periodic, place: [rho2], harmonic: 2,
     parameters: {a: {value: 0.011, unit: mm}, b: {value: -0.007, unit: mm}}}
"""
_BENT = """  - {effect: platform-deformation, place: [platform], form: 0, parameters: {kappa: {value: 0.02, unit: "1"}}}
"""
_COUPLED = "  - {effect: platform-deformation, place: [platform], form: 2, parameters: {" + (
    ", ".join(
        f'"K[{i},{j}]": {{value: {0.001 * ((7 * i + 3 * j) % 11 - 5):.3f}, unit: "1"}}'
        for i in range(1, 7)
        for j in range(1, 7)
    )
    + "}}\n"
)
_TURN_HEAT = (
    "  - {effect: thermal-expansion, place: [leg2], parameters: {alpha: {value: 1.2e-5, unit: 1/K}}}\n"
)
_WARM = "drivers: [approach.rho4, temperature.leg3]\neffects:\n"
LEGGED = {
    "plain_rails": _BARE_RAILS,
    "warm_rails": _BARE_RAILS + _WARM + _BACKLASH + _HEAT,
    "bent_rails": _BARE_RAILS + "effects:\n" + _BENT,
    "screw_rails": _BARE_RAILS + "effects:\n" + _SCREW,
    "coupled_rails": _BARE_RAILS + "effects:\n" + _COUPLED,
    "plain_turns": TURNS,
    "warm_turns": TURNS + "drivers: [temperature.leg2]\neffects:\n" + _TURN_HEAT,
    "weighed_rails": RAILS,
}
CLOSED_FORM = ("plain_rails", "warm_rails", "bent_rails", "plain_turns", "warm_turns")
BY_NEWTON = ("screw_rails", "coupled_rails")


@dataclass(frozen=True)
class Legged(Built):
    """The same with the functions for many poses."""

    def ik_n(
        self, poses: Array, guess: Array, p: Array | None = None
    ) -> tuple[int, Array, NDArray[np.int32]]:
        """How many rows failed, outputs (n, nq) that start as -7, and their return codes (n,)."""
        arrays = [np.ascontiguousarray(a, dtype=self.dtype) for a in (poses, guess)]
        out = np.full((len(poses), self.n), -7.0, dtype=self.dtype)
        codes = np.full(len(poses), -1, dtype=np.int32)
        given = None if p is None else np.ascontiguousarray(p, dtype=self.dtype)
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (*arrays, out, codes)]
        first = None if given is None else given.ctypes.data_as(ctypes.c_void_p)
        many = getattr(self.library, f"{self.machine.name}_ik_n")
        return int(many(first, None, ctypes.c_int(len(poses)), *pointers)), out.astype(float), codes


@cache
def legged(where: Path, name: str, real: Real = "double", flags: tuple[str, ...] = ()) -> Legged:
    """One of LEGGED, generated and compiled with ``flags`` too."""
    directory = where / "-".join([f"legged_{name}", real, *(flag.strip("-") for flag in flags)])
    file = where / f"{name}.yaml"
    file.write_text(HEAD.format(name=name) + LEGGED[name])
    machine = load_machine(file)
    generate(machine, directory, real)
    library = compile_library(directory, [f"{name}_kin.c", f"{name}_batch.c"], LEVEL, *flags)
    return Legged(machine, symbolic_model(machine, machine.effects), real, directory, library)
