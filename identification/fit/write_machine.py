"""A fit as a machine file: the user's own document with the estimated values in place.

``calibrated_document`` keeps everything the user wrote (order, units, tolerances) and adds what the fit
found: ``effects:`` with values and 1-sigma, ``pose_error:`` with what it is worth to the tool, ``covariance:`` (see
``truepose.identification.prediction.covariance``),
``nominal:`` with the drawing values and ``sessions:`` with the session numbers that were fitted.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from truepose.errors import InputError
from truepose.files import atomic_write_text
from truepose.identification.fit.estimated import Estimate, check_estimate
from truepose.identification.fit.noise import unexplained
from truepose.identification.fit.read_back import read_back
from truepose.identification.fit.summary import Judgement, judged
from truepose.identification.prediction.covariance import Covariance
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.file.driver import MEASURED_LOADS, ROW, Driver
from truepose.models.file.machine_file import machine_text
from truepose.models.file.sections import ExpectedPose
from truepose.models.machine.machine import Machine, Mass
from truepose.models.machine.mechanism import AXES, Direction, Parameter
from truepose.models.machine.seen import drivers_of
from truepose.models.units import UnitSystem, convert

FieldPath = tuple[str | int, ...]


def write_calibrated(
    path: Path | str,
    estimate: Estimate,
    recording: Recording,
    pose: ExpectedPose | None = None,
    judgement: Judgement | None = None,
    kept: Covariance | None = None,
) -> None:
    """Write the calibrated machine, whole or not at all; one that may not be called so says it first.

    ``judgement``: of the whole work where there is more than this fit; ``kept``: what was known before of what it held.
    Raises ReadBackError, and writes nothing, where the text would not be read as the machine that was fitted.
    """
    atomic_write_text(path, calibrated_text(path, estimate, recording, pose, judgement, kept)[0])


def calibrated_text(
    path: Path | str,
    estimate: Estimate,
    recording: Recording,
    pose: ExpectedPose | None = None,
    judgement: Judgement | None = None,
    kept: Covariance | None = None,
) -> tuple[str, Machine]:
    """Return what ``write_calibrated`` writes, and the machine that is read from it as from the file ``path``."""
    check_estimate(estimate)
    found = judged(estimate) if judgement is None else judgement
    known = known_of(estimate, recording, kept)
    text = machine_text(calibrated_document(estimate, recording, pose, found.why, kept, known), found.refusal)
    return text, read_back(text, Path(path), estimate, known, recording)


def calibrated_document(
    estimate: Estimate,
    recording: Recording,
    pose: ExpectedPose | None = None,
    refused: Sequence[str] = (),
    kept: Covariance | None = None,
    known: Covariance | None = None,
) -> dict[str, Any]:
    """The machine file of a fit, as a document of its own: nothing is shared with the machine's.

    ``pose``: what the fit is worth to the tool, where that was judged; ``refused``: why it may not be called a calibration;
    ``kept``: what was known before of what it held; ``known``: ``known_of`` the same, where it was worked out already.
    Raises InputError when the machine has no file or a parameter stands nowhere in it.
    """
    machine = estimate.nominal
    if machine.file is None:
        raise InputError(f"{machine.name}: found a machine without a file, expected one read by load_machine")
    document: dict[str, Any] = _unshared(machine.file.raw)
    if machine.mechanism.expanded is not None:
        _expand(document, machine)
    values = dict(zip(estimate.prior.names, estimate.p.tolist(), strict=True))
    free = [parameter for parameter in machine.parameters if parameter.free]
    for parameter in free:
        _write_parameter(document, parameter, values[parameter.name], machine)
    for direction in _directions(machine):
        _write_direction(document, direction, values)
    for key in ("effects", "covariance", "nominal", "sessions", "pose_error", "judgement"):
        document.pop(key, None)
    if _assumes_gravity(estimate) and machine.gravity is not None:
        document["gravity"] = [float(value) for value in machine.gravity]
    if estimate.effects:
        document["effects"] = _effect_entries(estimate, kept)
        _declare_drivers(document, estimate)
    document["covariance"] = (known or known_of(estimate, recording, kept)).document()
    document["nominal"] = {p.name: float(machine.nominal_values[p.name]) for p in free}
    document["sessions"] = list(recording.sessions)
    if refused:
        document["judgement"] = {"calibrated": False, "why": list(refused)}
    if pose is not None:
        said = {"than": pose.than, "before": pose.before, "after": pose.after}
        document["pose_error"] = {**said, "unit": "mm", "rows": pose.rows}
    return document


def _assumes_gravity(estimate: Estimate) -> bool:
    """Whether effects of weight were fitted although neither the file nor its description says which way gravity pulls."""
    machine = estimate.nominal
    stated = machine.file is not None and machine.file.gravity is not None
    return not stated and machine.mechanism.gravity is None and any(e.needs_load for e in estimate.effects)


def known_of(estimate: Estimate, recording: Recording, kept: Covariance | None = None) -> Covariance:
    """Return the covariance that the file holds: of the estimates, together with what was kept."""
    known = replace(covariance_of(estimate), seen=_seen(estimate, recording))
    return known if kept is None else known.beside(kept)


def covariance_of(estimate: Estimate) -> Covariance:
    """What readings and tolerances together know of the free entries, and what the model leaves unexplained."""
    free = estimate.prior.free
    names, scale = [estimate.prior.names[k] for k in free], estimate.prior.scale[free]
    if not names:
        return Covariance.of_tolerances(names, scale)
    known = Covariance.of(names, scale, estimate.root, estimate.known.unknown)
    own = unexplained(estimate.nominal, estimate.residual[estimate.used], estimate.effective_parameters)
    return replace(known, unexplained=own)


def _seen(estimate: Estimate, recording: Recording) -> dict[str, tuple[float, float]]:
    """Lowest and highest value in the fitted rows of joints and of what effects depend on; none without effects.

    Of the order of rows that of all rows: it tells the recording from others.
    """
    if not estimate.effects:
        return {}
    columns = dict(zip(recording.joints, recording.moved.T, strict=True))
    for name in dict.fromkeys(d for effect in estimate.effects for d in drivers_of(estimate.nominal, effect)):
        values = recording.driver(name)
        if values is not None:
            columns[name] = values
    used = {name: values if name == ROW else values[estimate.used] for name, values in columns.items()}
    return {name: (float(np.min(values)), float(np.max(values))) for name, values in used.items()}


def _expand(document: dict[str, Any], machine: Machine) -> None:
    """The mechanism as the graph that its form is short for; a tool frame that the form implies is written out."""
    assert machine.file is not None
    document["mechanism"] = _unshared(machine.mechanism.expanded)
    if machine.mechanism.inertials or machine.mechanism.table_frames:
        _write_weights(document, machine)
        _write_springs(document, machine)
    if machine.file.frames.is_stated("tool") or not machine.mechanism.tool_length:
        return
    frames = document.setdefault("frames", {})
    geometry = machine.geometry
    tool: dict[str, Any] = {"in": "flange", "xyz": [0.0] * 3, "rpy": [0.0] * 3}
    tolerance: dict[str, list[float]] = {"xyz": [0.0] * 3, "rpy": [0.0] * 3}
    for k, axis in enumerate(AXES):
        part, parameter = "xyz" if k < 3 else "rpy", geometry[f"tool.{axis}"]
        tool[part][k % 3] = in_file_units(parameter, parameter.nominal, machine.file.units)
        tolerance[part][k % 3] = in_file_units(parameter, parameter.tolerance, machine.file.units)
    frames["tool"] = {**tool, "tolerance": tolerance}


def _write_weights(document: dict[str, Any], machine: Machine) -> None:
    """Gravity and masses as the machine has them: a written-out mechanism has no other source of them, and no other frames
    for its links than its own."""
    if machine.gravity is not None:
        document["gravity"] = list(machine.gravity)
    if machine.masses:
        stated = document.get("masses") or {}
        document["masses"] = {
            mass.name: _weight(mass, stated.get(mass.name, {}), machine) for mass in machine.masses
        }


def _write_springs(document: dict[str, Any], machine: Machine) -> None:
    """Ends of springs in their bodies' own frames, as masses are."""
    for spring in machine.springs:
        for key, (body, at) in zip(("from", "to"), spring.ends, strict=True):
            point = [float(machine.units.from_internal(value, "length")) for value in at]
            document["loads"][spring.name][key] = {"in": body, "at": point}


def _weight(mass: Mass, stated: Mapping[str, Any], machine: Machine) -> dict[str, Any]:
    """A mass in its body's frame, with the tolerance that the file states of it."""
    com = [float(machine.units.from_internal(value, "length")) for value in mass.com]
    kept = {"tolerance": stated["tolerance"]} if "tolerance" in stated else {}
    return {"kg": mass.kg, "com": com, "in": mass.body, **kept}


def in_file_units(parameter: Parameter, value: float, units: UnitSystem) -> float:
    """A parameter's value (mm, rad) as its machine file writes it."""
    return float(convert(value, parameter.unit, parameter.written_in(units)))


def _write_parameter(document: dict[str, Any], parameter: Parameter, value: float, machine: Machine) -> None:
    assert machine.file is not None
    if not parameter.field:
        raise InputError(
            f"{machine.file.path}: parameter {parameter.name!r} was estimated, but this mechanism's form has "
            "no field for its value; give it tolerance 0 or describe the mechanism in another form"
        )
    _put(document, parameter.field, in_file_units(parameter, value, machine.file.units))


def _directions(machine: Machine) -> list[Direction]:
    """Axes that are estimated: at least one of their components is free."""
    geometry = machine.geometry
    axes = [joint.axis for joint in machine.mechanism.joints if isinstance(joint.axis, Direction)]
    return [
        axis for axis in axes if any(name is not None and geometry[name].free for name in axis.components)
    ]


def _write_direction(document: dict[str, Any], axis: Direction, values: Mapping[str, float]) -> None:
    """All three components: two estimated, the third what makes the vector a unit vector."""
    known = [values[name] for name in axis.components if name is not None]
    third = axis.sign * math.sqrt(max(0.0, 1.0 - math.fsum(v * v for v in known)))
    for k, name in enumerate(axis.components):
        _put(document, (*axis.field[:-1], k), third if name is None else values[name])


def _put(document: Any, path: FieldPath, value: float) -> None:
    """Set one number, making the mappings and three-component lists that are not written out yet."""
    here = document
    for key, following in itertools.pairwise(path):
        if isinstance(here, dict) and here.get(key) is None:
            here[key] = [0.0, 0.0, 0.0] if isinstance(following, int) else {}
        here = here[key]
    here[path[-1]] = value


def _effect_entries(estimate: Estimate, kept: Covariance | None) -> list[dict[str, Any]]:
    std = dict(zip(estimate.prior.names, estimate.std.tolist(), strict=True))
    if kept is not None:
        std |= dict(zip(kept.names, np.linalg.norm(kept.factor, axis=1).tolist(), strict=True))
    return [effect_entry(effect, std) for effect in estimate.fitted_effects()]


def _declare_drivers(document: dict[str, Any], estimate: Estimate) -> None:
    """What effects read and the file does not name is declared from now on: columns that were tried, torques and currents."""
    machine = estimate.nominal
    named = {d.name for d in machine.file.drivers} if machine.file else set()
    named |= {
        d.name for d in machine.declared_drivers if d.column or d.absent is not None
    }  # the file has them otherwise
    read = dict.fromkeys(name for effect in estimate.effects for name in effect.drivers)
    known = {d.name: d for d in map(machine.declared, read) if d is not None and d.name not in named}
    added = list[dict[str, Any]]()
    for d in known.values():
        # what a joint's drive holds would drive other joints, where nothing was said
        more = d.everywhere or Driver.of(d.name).kind not in MEASURED_LOADS
        unit = {"unit": d.unit} if d.unit else {}
        added.append({"name": d.name} | unit | ({"drives": d.drives} if more else {}))
    if added:
        document["drivers"] = [*document.get("drivers", ()), *added]


def effect_entry(effect: PlacedEffect, std: Mapping[str, float]) -> dict[str, Any]:
    """One entry of ``effects:``; ``std`` by full name (label:coefficient)."""
    parameters = {
        c.name: {"value": effect.values[c.name], "unit": c.unit, "std": std[f"{effect.label}:{c.name}"]}
        for c in effect.coefficients
    }
    entry: dict[str, Any] = {"effect": effect.effect.slug, "place": list(effect.place)}
    return {**entry, **dict(effect.settings), "parameters": parameters}


def _unshared(value: Any) -> Any:
    """A deep copy in which nothing is shared: two legs that alias one list become two lists."""
    if isinstance(value, Mapping):
        return {key: _unshared(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_unshared(item) for item in value]
    return value
