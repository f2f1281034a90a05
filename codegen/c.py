"""The controller's C from a machine: ``generate`` writes a directory of C99 that needs only ``math.h``.

The symbolic model that identification fits is printed as scalar C (``expressions``, ``printer``); a small
solver that is the same for every machine is a template beside it. Nothing here knows a kind of machine:
an open chain is one without passive coordinates.

Poses of ``example.c``: such as every set of features solves, so that only wrong code fails there.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.codegen.blocks import blocks_of, driver_units, entries, offered
from truepose.codegen.chain import six_joints
from truepose.codegen.features import ALL, Features, left_out, left_out_words
from truepose.codegen.layout import Layout, layout_of
from truepose.codegen.loop_blocks import easing_context, task_context
from truepose.codegen.printer import Real, literal, trigonometry
from truepose.codegen.reference import Reference, slopes_of, strain_of
from truepose.codegen.texts import environment, pruned, wrappers
from truepose.errors import InputError
from truepose.files import atomic_directory
from truepose.models.file.names import check_machine_name
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.machine import FRAME_OF, Machine, MachineLike, as_machine
from truepose.models.machine.mechanism import coupling_matrix
from truepose.models.machine.seen import SeenRanges
from truepose.models.machine.velocities import twists

MAX_ITER = 1500
"""Evaluations of the model that one inverse of an open chain may take."""
SPARE_MAX_ITER = 4000
"""The same where there are joints to spare, whose ranges leave many solutions outside."""
CLOSED_MAX_ITER = 400
"""The same of a closed chain."""
POINTING_STARTS = 12
"""Places from which two joints are tried to point somewhere: a direction is met from few of them on each side of the pier."""
_LIMITS = {
    "fk_limit": 300,
    "attempt_limit": 40,
    "seed_limit": 20,
    "care_limit": 20,
    "all_iter": 4000,
    "polish_limit": 12,
    "lane_limit": 7,  # steps taken together in lanes; stragglers go on alone
    "zero_rounds": 40,  # rounds of steps for all zeros of a polynomial, at most
    "slack": 0.1,  # rad that a zero may be off the unit circle to be a start: effects bend the real arm
    "quiet": 320,  # starts in a row without a new solution that end a search
    "together": 16,  # starts of a search that are looked at together
    "leaps": 6,
    "patience": 2,
}
_PARTS = ("batch", "state")
"""Files that a feature has for itself."""


def generate(
    machine: MachineLike,
    directory: Path,
    real: Real = "double",
    *,
    nominal: Mapping[str, float] | None = None,
    features: Features | str = ALL,
) -> list[Path]:
    """Write the C of ``machine`` with its effects into ``directory``, whole or not at all; the paths written.

    ``real`` is the type of every number. ``nominal`` gives values of the drawing by parameter name (mm, rad)
    for ``NAME_compensate``; what it does not name, and all without it, is as the machine file has it. ``features``: what is
    generated, everything by default, or a list ("warm,p"); files of features that an earlier run had are deleted.

    Raises InputError when the machine's name is no C identifier, ``nominal`` names an unknown parameter, or a feature was
    asked for that this machine cannot have.
    """
    machine = as_machine(machine)
    check_machine_name(machine.name)
    if real not in ("double", "float"):
        raise InputError(f"real: found {real!r}, expected 'double' or 'float'")
    chosen = Features.of(features) if isinstance(features, str) else features
    texts = render(machine, real, nominal=nominal, features=chosen)
    with atomic_directory(directory) as partial:
        for name, text in texts.items():
            (partial / name).parent.mkdir(exist_ok=True)
            (partial / name).write_text(text, encoding="utf-8", newline="\n")
    parts = {f"{machine.name}_{part}.{end}" for part in _PARTS for end in "hc"}
    for stale in parts - texts.keys():  # of an earlier run: a wrapper would compile them
        (Path(directory) / stale).unlink(missing_ok=True)
    return [Path(directory) / name for name in texts]


def render(
    machine: Machine, real: Real, *, nominal: Mapping[str, float] | None = None, features: Features = ALL
) -> dict[str, str]:
    """The files of ``generate`` as texts by file name."""
    model = symbolic_model(machine, machine.effects)
    layout = layout_of(model, real)
    context = _context(model, layout, real, _nominal(model, nominal), features)
    if features.listed and features.branches and not context["lists_all"]:
        raise InputError(
            f"features: found branches, but {machine.name} is no open chain of six readings that meets whole poses; "
            "leave it out"
        )
    texts = {file: environment().get_template(template).render(context) for file, template in _files(context)}
    if features.listed:
        texts = {
            file: pruned(text, machine.name) if file.endswith(".c") else text for file, text in texts.items()
        }
    return {**texts, "test_vectors.csv": _vectors(model, layout), **wrappers(context)}


def _context(
    model: SymbolicModel, layout: Layout, real: Real, ideal: list[float], features: Features
) -> dict[str, Any]:
    """What the templates read: the expressions, and all beside them. ``ideal``: nominal p (np,)."""
    blocks = blocks_of(model, layout, real, features)
    return {
        **_numbers(real),
        **_sizes(model, layout),
        **_interface(model, layout),
        **example_context(model, layout, single=real == "float"),
        **_pointing(model, layout),
        "blocks": blocks.texts,
        "fixed_block": blocks.texts[0],
        "lane_blocks": blocks.lane_texts,
        "trig": any("sin_cos(" in text for text in blocks.texts) or features.listed,
        "moves": blocks.moves,
        "operations": blocks.operations,
        **(blocks.loops.context if blocks.loops else dict.fromkeys(("loops", "whole", "roots", "legs"))),
        "per_unit": np.array(layout.bounded).astype(bool) / layout.unknown,
        "mixed": blocks.chain is not None and blocks.chain.mixed is not None,
        "rolled": blocks.chain is not None and blocks.chain.six and blocks.chain.steps.numel() > 0,
        **six_joints(model, blocks.chain, layout, real, features),
        "kept": blocks.kept(model.p_home.tolist(), model.z_home.tolist()),
        "drawn": blocks.kept(ideal, model.z_home.tolist()),
        "nominal": ideal,
        **offered(features, model, layout, blocks, ideal),
        "easing": easing_context(layout, single=real == "float"),
        "held": left_out_words(left_out(model.machine, features)),
    }


def _files(context: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Names of the files beside the wrappers, and their templates."""
    name, has = context["name"], context["has"]
    parts = ["kin", *(["batch"] if has.batch else []), *(["state"] if context["memory"] else [])]
    first, *others = [[(f"{name}_{part}.{end}", f"{part}.{end}.j2") for end in "hc"] for part in parts]
    files = [*first, ("example.c", "example.c.j2"), *(file for part in others for file in part)]
    return [*files, ("CMakeLists.txt", "CMakeLists.txt.j2"), ("README.md", "README.md.j2")]


def _numbers(real: Real) -> dict[str, Any]:
    """How numbers are written, and what the solver is told of their precision."""

    def lit(value: float) -> str:
        return literal(float(value), real)

    def numbers(values: Iterable[float]) -> str:
        return ", ".join(lit(v) for v in values)

    single = real == "float"
    return {
        "real": real,
        "f": "f" if single else "",
        **trigonometry(real),
        "limit": "1e37f" if single else "1e300",
        "chord": 1e-2 if single else 2e-3,
        "variants": 12,
        "longest": 0.5,
        "small_turn": 0.1 if single else 0.03,
        "smallest": 1e-9 if single else 1e-13,
        "lit": lit,
        "numbers": numbers,
        "wide": lambda values: ", ".join(literal(float(v), "double") for v in values),
        "table": lambda values: "\n".join(f"    {lit(v)}," for v in values),
    }


def _sizes(model: SymbolicModel, layout: Layout) -> dict[str, Any]:
    """Sizes of the model, where its iterations start, and how many there may be."""
    nx = len(model.home)
    return {
        "layout": layout,
        "nx": nx,
        "nc": model.closure.numel(),
        "ng": model.gap.numel(),
        "strain": strain_of(model),
        "forces": layout.bounded.count(0),
        "stride": 0.5 if nx else 1.0,
        "max_iter": CLOSED_MAX_ITER if nx else SPARE_MAX_ITER if len(layout.near) > 6 else MAX_ITER,
        **_LIMITS,
        "home": np.concatenate([layout.near, layout.home]),
        "slopes": slopes_of(len(model.readings)),
        "turns": any(layout.turns),
        "turning": [int(turn) for turn in layout.turns],
        "task": task_context(layout.task),
    }


def _interface(model: SymbolicModel, layout: Layout) -> dict[str, Any]:
    """Names, units and usual values of what a caller gives."""
    places, seen = {name: k for k, name in enumerate(model.names)}, SeenRanges.of(model)
    return {
        "name": model.machine.name,
        "p0": model.p_home,
        "z0": model.z_home if len(model.z_home) else np.zeros(1),
        "tool": [places[f"tool.{axis}"] for axis in ("x", "y", "z", "rx", "ry", "rz")],
        "parameters": entries(model.names, [*model.machine.parameter_units.values()]),
        "joints": _joints(model.machine),
        "drivers": entries(model.drivers, driver_units(model)),
        "seen": [*zip(seen.places, *seen.ends, strict=True)],
        "uncoupling": coupling_matrix(model.machine.mechanism),
        "tolerance": {"position": f"{layout.position:g}", "rotation": f"{layout.rotation:g}"},
    }


def _pointing(model: SymbolicModel, layout: Layout) -> dict[str, Any]:
    """What ``NAME_point`` needs: the axis of the tool that two turning joints point; None where nothing is pointed."""
    of = [sensor.pointed for sensor in model.machine.sensors if sensor.pointed]
    two = len(layout.turns) == 2 and all(layout.turns) and not len(model.home)
    return {
        "pointed": "xyz".index(of[0]) if of and two else None,
        "pointing_met": (layout.share * layout.rotation) ** 2,
        "pointing_tight": (layout.tight * layout.rotation) ** 2,
        "pointing_limit": MAX_ITER,
        "pointing_starts": POINTING_STARTS,
    }


def _nominal(model: SymbolicModel, nominal: Mapping[str, float] | None) -> list[float]:
    """Nominal p: geometry as told, the tool's frame as calibrated, effects at zero."""
    geometry = model.machine.geometry
    unknown = [name for name in nominal or {} if name not in geometry]
    if unknown:
        raise InputError(
            f"nominal: found {unknown[0]!r}, expected names of parameters of {model.machine.name}"
        )
    broken = [name for name, value in (nominal or {}).items() if not math.isfinite(value)]
    if broken:
        raise InputError(
            f"nominal: found {broken[0]} = {(nominal or {})[broken[0]]}, expected a finite number"
        )
    own = dict(zip(model.names, model.p_home, strict=True))
    drawn = {name: value for name, value in (nominal or {}).items() if FRAME_OF.get(name) != "tool"}
    return [float(drawn.get(name, own[name])) if name in geometry else 0.0 for name in model.names]


def _joints(machine: Machine) -> list[dict[str, Any]]:
    return [
        {
            "place": place,
            "name": a.reading,
            "unit": a.reading_unit,
            "range": f" {a.reading_range[0]:.9g} to {a.reading_range[1]:.9g}" if a.reading_range else "",
        }
        for place, a in enumerate(machine.mechanism.actuators)
    ]


def _vectors(model: SymbolicModel, layout: Layout) -> str:
    """CSV of joints (column units) and poses T0 ... T11 at the calibrated parameters."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*model.readings, *(f"T{k}" for k in range(12))])
    for q, pose in layout.vectors:
        writer.writerow([repr(float(v)) for v in (*q, *pose[:3].ravel())])
    return text.getvalue()


_EXAMPLES = 8


def example_context(model: SymbolicModel, layout: Layout, *, single: bool) -> dict[str, Any]:
    """Return the vectors of ``example.c``, how far its guesses stand aside, and what it allows.

    The vectors are the first of the samples in the better half by ``regularity``: from a guess next to a singular pose right
    code may find other joints, or none.
    """
    slack = 3.0 if single else 1.0  # rounding of p and q in single precision is not the solver's doing
    regular = regularity(model, layout)
    chosen = np.flatnonzero(regular >= np.median(regular))[:_EXAMPLES]
    return {
        "vectors": [(q, pose[:3].ravel()) for q, pose in (layout.vectors[k] for k in chosen)],
        "aside": np.minimum(50.0 * layout.unknown[: len(layout.near)], 0.02 * layout.width),
        "position": slack * layout.position,
        "rotation": slack * layout.rotation,
    }


def regularity(model: SymbolicModel, layout: Layout) -> Array:
    """Return the smallest singular value (n,) of what the solver inverts at each of the layout's vectors, mm a mm."""
    y = ca.vertcat(model.q, model.x)
    motion = twists(model.pose, y)
    motion[3:, :] = model.pose[:3, :3].T @ motion[3:, :]
    rows = [*layout.task.rows, *range(6, 6 + model.closure.numel())]
    scaled = (
        ca.diag(layout.weight) @ ca.vertcat(motion, ca.jacobian(model.closure, y)) @ ca.diag(layout.unknown)
    )
    at = ca.Function("solved", [model.q, model.z, model.p, model.x], [ca.densify(scaled[rows, :])])
    reference, out = Reference(model), []
    for q, _ in layout.vectors:
        x = reference.passive(q)
        matrix = np.array(at(q, model.z_home, model.p_home, model.home if x is None else x))
        out.append(np.linalg.svd(matrix, compute_uv=False)[-1])
    return np.round(out, 9)  # the last digits of another mathematical library choose no other poses
