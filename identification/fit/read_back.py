"""Read the text of a calibrated machine back before it is published: it must hold the machine that was fitted."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from truepose.arrays import Array, Mask
from truepose.errors import InputError, ReadBackError
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.covariance import Covariance, covariance_of_file
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.file.machine_file import checked_machine
from truepose.models.file.yaml_document import parse_document
from truepose.models.load import build_machine
from truepose.models.machine.machine import Machine

ROWS = 10
"""Rows whose poses are predicted by both machines."""
SAME = 1e-9
"""Largest difference of a pose, as a share of the machine's reach or of a radian."""
ROUNDING = 1e-12
"""Largest difference of a constant or a coefficient, as a share of its size: degrees are converted and back."""
PACKED = 1e-6
"""Largest difference of the covariance's factor, as a share of its row: many names are packed in single precision."""


def read_back(text: str, path: Path, fit: Estimate, known: Covariance, recording: Recording) -> Machine:
    """Return the machine that the text for the file ``path`` holds, after comparing it with the fit.

    ``known``: what is known of the estimates; ``recording``: the rows that were fitted, of which some are predicted.
    Raises ReadBackError where the text cannot be read, or holds another machine.
    """
    try:
        machine = build_machine(checked_machine(path, parse_document(text, path)))
    except InputError as exc:
        raise ReadBackError(f"{path.name}: what was to be written cannot be read: {exc}") from exc
    for difference in _differences(machine, fit, known, recording):
        raise ReadBackError(f"{path.name}: what was to be written reads as another machine: {difference}")
    return machine


def _differences(machine: Machine, fit: Estimate, known: Covariance, recording: Recording) -> Iterator[str]:
    """Yield in words what a machine and a fit do not share; the costly comparison of predictions comes last.

    A frame that alone was fitted had no tolerance in the fit, and keeps that of the file.
    """
    for name, (value, tolerance) in _constants(fit.nominal, fit.p.tolist()).items():
        found = machine.geometry.get(name)
        if found is None:
            yield f"{name} is missing"
        elif not _close(found.nominal, value) or not (
            tolerance == math.inf or _close(found.tolerance, tolerance)
        ):
            yield f"{name} is {found.nominal!r} +- {found.tolerance!r}, expected {value!r} +- {tolerance!r}"
    effects = fit.fitted_effects()
    if [e.label for e in machine.effects] != [e.label for e in effects]:
        yield f"its effects are {', '.join(map(str, machine.effects))}, expected {', '.join(map(str, effects))}"
    for read, made in zip(machine.effects, effects, strict=False):
        same = len(read.amplitudes) == len(made.amplitudes) and _close(read.amplitudes, made.amplitudes)
        if read.settings != made.settings or read.drivers != made.drivers or not same:
            yield f"{made.label} is {dict(read.settings)} {read.amplitudes}, expected {dict(made.settings)} {made.amplitudes}"
    if machine.file is None or machine.file.sessions != recording.sessions:
        yield f"its sessions are not {list(recording.sessions)}"
    if not _same_covariance(machine, known):
        yield "its covariance is another one"
    away = _distance(machine, fit, recording)
    if not away <= SAME:
        yield f"poses of {ROWS} rows differ by {away:.1e} of the machine's reach"


def _constants(machine: Machine, values: list[float]) -> dict[str, tuple[float, float]]:
    """Return estimate and tolerance of each constant by name."""
    return {p.name: (v, p.tolerance) for p, v in zip(machine.parameters, values, strict=False)}


def _close(a: object, b: object) -> bool:
    return bool(np.allclose(np.asarray(a, float), np.asarray(b, float), rtol=ROUNDING, atol=1e-15))


def _same_covariance(machine: Machine, known: Covariance) -> bool:
    found = covariance_of_file(machine)
    if (
        found is None
        or found.names != known.names
        or found.unexplained != known.unexplained
        or found.seen != known.seen
    ):
        return False
    size = PACKED * np.linalg.norm(known.factor, axis=1, keepdims=True)
    return bool((np.abs(found.factor - known.factor) <= size).all()) and _close(found.unknown, known.unknown)


def _distance(machine: Machine, fit: Estimate, recording: Recording) -> float:
    """Return the largest difference of the tool's poses of both machines, as a share of the reach (mm) or of a radian."""
    rows = np.flatnonzero(np.isfinite(fit.residual).all(axis=1))
    if not len(rows):
        return 0.0
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, ROWS).astype(int))]
    part = recording.subset(rows)
    part = replace(
        part, from_row=None if part.from_row is None else part.rows
    )  # no pose depends on another row
    read, made = Predictor(machine, part, machine.effects), Predictor(fit.nominal, part, fit.effects)
    poses, closed = _poses(read, read.model.p_home, fit.x[rows])
    expected, good = _poses(made, fit.p, fit.x[rows])
    if (closed != good).any():
        return math.inf
    gap, reach = (poses - expected)[good], max(1.0, float(np.max(np.abs(expected[good, :3, 3]), initial=0.0)))
    return float(
        np.max(
            [np.max(np.abs(gap[:, :3, :3]), initial=0.0), np.max(np.abs(gap[:, :3, 3]), initial=0.0) / reach]
        )
    )


def _poses(predictor: Predictor, p: Array, start: Array) -> tuple[Array, Mask]:
    """Return poses (n, 4, 4), mm, and which rows (n,) could be assembled, from ``start`` (n, nx)."""
    x, good = predictor.assemble(p, start)
    return predictor.poses(p, x)[0], good
