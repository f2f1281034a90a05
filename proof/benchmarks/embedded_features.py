"""What the generated C takes on a controller by features, beside Newton's method on CasADi's own C, in one run.

    python -m benchmarks.embedded_features

The UR10 of `benchmarks/embedded.py`, double on Cortex-M7 and float on Cortex-M4F. The peer is what an engineer gets in an
afternoon: pose and Jacobian of the same calibrated constants as `casadi.Function.generate` writes them, sine and cosine of
the C library, full Newton steps (`benchmarks/newton_peer.c`) to the same tolerance. It checks neither its input nor joint
ranges, and has no other starts. KDL and pinocchio need C++ with a heap: they do not compile for these targets.

Last, what it takes to follow drivers that remember: a UR10 with play in six joints, friction in one, and a link that
warms up behind its thermometer.
"""

from __future__ import annotations

import importlib.util
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

import casadi as ca
import numpy as np
from embedded import REALS, SEED, ur10

from truepose.codegen.c import generate
from truepose.codegen.features import ALL, Features
from truepose.codegen.layout import layout_of
from truepose.codegen.leaves.embedded.measure import OPTIMISATIONS, Measurement, measure
from truepose.codegen.printer import Real, literal
from truepose.errors import InputError
from truepose.models import lie
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.velocities import chain_of

LISTS = ("", "warm,cold,branches,p", "warm,cold,branches", "warm,cold", "warm,p", "warm")
POSES = 10_000
NEWTON = Path(__file__).parent / "newton_peer.c"
REMEMBERS = """effects:
{play}
  - {{effect: friction-hysteresis, place: [q2], width: 0.01, parameters: {{h: {{value: 2.0e-4, unit: rad}}}}}}
  - {{effect: thermal-expansion, place: [link2], lag: 900, parameters: {{alpha: {{value: 1.2e-5, unit: 1/K}}}}}}
"""
PLAY = "  - {{effect: backlash, place: [q{k}], parameters: {{b: {{value: 3.0e-4, unit: rad}}}}}}"


def peer(model: SymbolicModel, ours: Path, into: Path, real: Real) -> Path:
    """The peer's C with the interface, and beside the test vectors, of what lies in ``ours``."""
    name, layout = model.machine.name, layout_of(model, real)
    outputs = [ca.densify(ca.substitute(part, model.p, model.p_home)) for part in pose_and_jacobian(model)]
    function = ca.Function("model", [model.q], outputs)
    into.mkdir()
    options = {"casadi_int": "int", "casadi_real": real, "with_header": False}
    code = ca.CodeGenerator("model.c", options)
    code.add(function)
    sizes = {
        "PEER(tail)": f"{name}_##tail",
        "CASADI_ARGS": function.sz_arg(),
        "CASADI_RESULTS": function.sz_res(),
        "CASADI_INTS": function.sz_iw() or 1,
        "CASADI_REALS": function.sz_w() or 1,
        "HALF": literal(0.5, real),
        "ABS": "fabsf" if real == "float" else "fabs",
        "SMALL": literal(1e-9 if real == "double" else 1e-5, real),
        "LARGE": literal(1e30, real),
        "MET_MM": literal(layout.share * layout.position, real),
        "MET_RAD": literal(layout.share * layout.rotation, real),
    }
    text = [f'#include "{name}_kin.h"', "#include <math.h>", *_QUIET, *(_SINGLE if real == "float" else [])]
    text += [f"#define {key} {value}" for key, value in sizes.items()]
    text += [f"typedef {name}_real real;", code.dump(), NEWTON.read_text(encoding="utf-8")]
    (into / f"{name}_kin.c").write_text("\n".join(text), encoding="utf-8")
    for file in (f"{name}_kin.h", "test_vectors.csv"):
        shutil.copy(ours / file, into)
    return into


def pose_and_jacobian(model: SymbolicModel) -> tuple[ca.SX, ca.SX]:
    """[R|p] of an arm row by row, and its geometric Jacobian (6, nq): axes, and their moments about the tool."""
    chain = chain_of(model)
    assert chain is not None
    at, axes = ca.SX.eye(4), list[tuple[ca.SX, ca.SX]]()
    for move in chain.plain:
        at = at @ move.before
        axes.append((at[:3, 2], at[:3, 3]))
        at = at @ lie.rot_z(move.value)
    at = at @ chain.after
    columns = [ca.vertcat(ca.cross(axis, at[:3, 3] - origin), axis) for axis, origin in axes]
    return ca.vec(at[:3, :].T), ca.horzcat(*columns)


_SINGLE = ['#pragma GCC optimize ("single-precision-constant")', "#define sin sinf", "#define cos cosf"]
"""CasADi writes double constants and functions in single precision, too: with these all of it is computed in single."""
_QUIET = [
    f'#pragma GCC diagnostic ignored "-W{warning}"'
    for warning in (
        "conversion",
        "float-conversion",
        "double-promotion",
        "shadow",
        "unused-parameter",
        "pedantic",
    )
]


def table(titles: list[str], found: list[Measurement], theirs: Measurement) -> list[str]:
    """Lines of Markdown: bytes and instructions, and how many times the peer's."""
    lines = [
        "| features | `.o` | linked for the inverse | peer's / ours | warm: instructions | peer's / ours | stack |"
    ]
    lines.append("|---|---|---|---|---|---|---|")
    for title, m in zip([*titles, "peer"], [*found, theirs], strict=True):
        failed = sum(m.warm.codes[1:])
        lines.append(
            f"| {title} | {m.object.text:,} B | {m.linked_ik.text + m.linked_ik.data:,} B "
            f"| {(theirs.linked_ik.text + theirs.linked_ik.data) / (m.linked_ik.text + m.linked_ik.data):.2f} "
            f"| {m.warm.median:,.0f}{f' ({failed} failed)' if failed else ''} "
            f"| {theirs.warm.median / m.warm.median:.2f} | {m.warm.stack:,} B |"
        )
    return lines


def compared(machine: Machine, folder: Path) -> None:
    """Print a table for each precision and optimisation."""
    model = symbolic_model(machine, machine.effects)
    titles = [f"`{names}`" if names else "all, no list" for names in LISTS]
    for real in REALS:
        for k, names in enumerate(LISTS):
            generate(machine, folder / f"{real}{k}", real, features=Features.of(names) if names else ALL)
        beside = peer(model, folder / f"{real}{len(LISTS) - 1}", folder / f"{real}-peer", real)
        for level in OPTIMISATIONS:
            found = [measure(folder / f"{real}{k}", optimisation=level) for k in range(len(LISTS))]
            theirs = measure(beside, optimisation=level)
            head = f"### {found[0].target.title}, {real}, `{level}`"
            sys.stdout.write("\n".join([head, "", *table(titles, found, theirs), "", ""]))


def followed(file: Path, folder: Path) -> None:
    """Print what an update of the state takes."""
    play = "\n".join(PLAY.format(k=k) for k in range(1, 7))
    drivers = "drivers: [temperature.link2]\n"
    file.write_text(ur10() + drivers + REMEMBERS.format(play=play), encoding="utf-8")
    machine = load_machine(file)
    for real in REALS:
        generate(machine, folder / f"state-{real}", real)
        for level in OPTIMISATIONS:
            found = measure(folder / f"state-{real}", optimisation=level)
            assert found.state and found.state_object
            sys.stdout.write(
                f"{found.target.title}, {real}, `{level}`: an update of the state {found.state.median:,.0f} instructions "
                f"(at most {found.state.most:,}), {found.state.stack:,} B of stack, {found.state_object.text:,} B of code\n"
            )


def from_nearby(folder: Path) -> None:
    """Print how many random poses are not met from a nearby guess alone; computed here, not on the target."""
    random, code = np.random.default_rng(SEED), Counter[str]()
    for real in REALS:
        where = folder / f"{real}{len(LISTS) - 1}" / "wrappers" / "ur10_kin.py"
        spec = importlib.util.spec_from_file_location(f"near_{real}", where)
        assert spec and spec.loader
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        arm = module.build()
        for away in (0.1, 1.0, 10.0):
            code.clear()
            for _ in range(POSES):
                q = random.uniform(-3, 3, 6)
                guess = q + random.choice([-1, 1], 6) * np.radians(away)
                try:
                    arm.ik(arm.fk(q), guess)
                except module.KinematicsError as error:
                    code[type(error).__name__] += 1
            sys.stdout.write(
                f"{real}: guess {away:g} deg away in every joint: of {POSES:,} poses not met {dict(code)}\n"
            )


def main() -> int:
    """Generate, measure and print; 2 when something is missing."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "ur10.yaml").write_text(ur10(), encoding="utf-8")
        try:
            compared(load_machine(folder / "ur10.yaml"), folder)
            from_nearby(folder)
            followed(folder / "ur10.yaml", folder)
        except InputError as exc:
            sys.stderr.write(f"error: {exc}\n")
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
