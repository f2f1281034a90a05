"""One result of every kind that a public function gives, made once; and whether two of them hold the same."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache, partial
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from support.experiments import UNEVEN, YIELDING, planned
from truepose.identification.compensation.compensate import compensate
from truepose.identification.compensation.inverse import PoseSolver, inverse
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.calibrate import Calibration, calibrate
from truepose.identification.identifiability.analysis import Identifiability, identifiability
from truepose.identification.leaves.drift.analysis import Drift, drift
from truepose.identification.leaves.planning.plan import plan
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.shown.result import Shown

BUNDLED = ("telescope", "nanopositioner", "polisher")


def bundle(name: str) -> Path:
    """The folder of a bundled machine."""
    return Path(str(resources.files("truepose.models") / "machines" / name))


@cache
def machine(name: str = "telescope") -> Machine:
    return load_machine(bundle(name) / "machine.yaml")


@cache
def recording(name: str = "telescope") -> Recording:
    return load_recording(machine(name), [bundle(name) / "recording.csv"])


@cache
def calibration() -> Calibration:
    return calibrate(machine(), recording())


@cache
def diagnosis() -> Diagnosis:
    return diagnose(machine(), recording())


@cache
def drifting(moved: float = 0.0) -> Drift:
    """Halves of the telescope's recording as sessions; between them its base moved by so many mm."""
    table = recording().to_frame().reset_index(drop=True)
    table = table.assign(session=1 + (table.index >= len(table) // 2), role="calibration")
    table.loc[len(table) // 2 :, [f"P{k}.x" for k in range(1, 13)]] += moved
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sessions.csv"
        table.to_csv(path, index=False)
        return drift(machine(), load_recording(machine(), [path]))


def _told(name: str) -> Identifiability:
    return identifiability(machine(name), machines=1)


def _poses() -> np.ndarray[Any, Any]:
    solver = PoseSolver(machine())
    return solver.forward(recording().q[:4])[0]


RESULTS: Mapping[str, Callable[[], Shown]] = {
    **{f"machine {name}": partial(machine, name) for name in BUNDLED},
    **{f"recording {name}": partial(recording, name) for name in BUNDLED},
    "machine with effects": lambda: diagnosis().after.nominal.with_effects(
        diagnosis().after.fitted_effects()
    ),
    "some rows": lambda: recording().subset([5, 3, 3]),
    "no rows": lambda: recording().subset([]),
    "calibration": calibration,
    "estimate": lambda: calibration().fit,
    "diagnosis": diagnosis,
    "finding": lambda: diagnosis().findings[0],
    "drift": drifting,
    "moved base": lambda: drifting(0.2),
    **{f"identifiability {name}": cache(partial(_told, name)) for name in BUNDLED},
    "plan": cache(lambda: plan(machine(), 20, method="random")),
    "plan of changes": cache(lambda: plan(machine("nanopositioner"), 30, method="random")),
    "experiment": lambda: planned("arm", YIELDING, UNEVEN),
    "compensation": cache(lambda: compensate(machine(), recording())),
    "inverse": cache(lambda: inverse(machine(), _poses())),
}
"""Makers by name; a kind appears more than once where its results differ much."""


def same(a: Any, b: Any) -> bool:
    """Whether two results hold the same: field by field, arrays entry by entry (NaN is NaN)."""
    if a is b or type(a) is not type(b):
        return a is b
    if isinstance(a, np.ndarray | float):
        return np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f")
    if isinstance(a, Mapping):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, Sequence) and not isinstance(a, str):
        return len(a) == len(b) and all(map(same, a, b))
    if is_dataclass(a):
        return all(same(getattr(a, one.name), getattr(b, one.name)) for one in fields(a))
    comparison: Any = type(a).__eq__
    plain = comparison is object.__eq__  # an effect: a class of formulas
    return same(vars(a), vars(b)) if plain else bool(a == b)
