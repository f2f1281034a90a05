"""Joints that a formula moves: linkages against the circles that they are drawn with, derivatives, fits, C, refusals."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pandas as pd
import pytest
import sympy  # type: ignore[import-untyped]
from hypothesis import given, settings
from hypothesis import strategies as st

import truepose
from support.command import input_error
from support.generated_c import built_of, needs_compiler
from support.machine_texts import machine_from
from truepose.api import calibrate
from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.file.formula import Formula
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

GROUND, CRANK, COUPLER, ROCKER = 300.0, 120.0, 280.0, 200.0
"""mm: a four-bar linkage whose opposite bars are unequal."""
HEAD = "schema: truepose/machine/1\nname: linkage\n{units}"
FORM = """mechanism:
  type: graph
  bodies: [base, crank, rocker]
  joints:
    - {{name: q1, kind: revolute, parent: base, child: crank, actuated: true, range: [-80, 80]}}
    - {{name: rock, kind: revolute, parent: base, child: rocker, xyz: [{g}, 0, 0], computed: "{law}",
       lengths: {{g: {g}, a: {a}, b: {b}, c: {c}}}}}
frames: {{tool: {{in: flange, xyz: [{t}, 0, 0]}}}}
sensor: {{type: pose, sigma: {{xyz: 0.01, rot: 0.002}}}}
"""
DIAGONAL = "sqrt((g - a*cos(q1))**2 + (a*sin(q1))**2)"
LAW = f"180 - atan2(a*sin(q1), g - a*cos(q1)) - acos((c**2 + {DIAGONAL}**2 - b**2) / (2*c*{DIAGONAL}))"
"""The rocker's angle from the ground line: the diagonal's, and that between diagonal and rocker by the law of cosines."""


def linkage(folder: Path, law: str = LAW, *, units: str = "", more: str = "") -> Machine:
    k = 0.001 if "length: m," in units else 1.0
    law = law.replace("180", "pi") if "rad" in units else law
    bars = {"g": GROUND * k, "a": CRANK * k, "b": COUPLER * k, "c": ROCKER * k, "t": 50 * k}
    written = FORM.format(law=law.replace("pi", repr(np.pi)), **bars)
    if "rad" in units:
        written = written.replace("[-80, 80]", "[-1.4, 1.4]")
    if k != 1.0:
        written = written.replace("xyz: 0.01,", "xyz: 0.00001,")
    return machine_from(folder, HEAD.format(units=units) + written + more, "linkage")


def predictor_of(machine: Machine, q1: Array) -> Predictor:
    return Predictor(machine, load_recording(machine, {"q1": q1}, need_observations=False))


def poses_of(machine: Machine, q1: Array) -> Array:
    predictor = predictor_of(machine, q1)
    return predictor.poses(predictor.model.p_home)[0]


def rocker(q: float, crank: float = CRANK) -> float:
    """Angle of the rocker (rad): where circles about the crank's end and the rocker's pivot meet, above the ground."""
    end = crank * np.array([np.cos(q), np.sin(q)])
    to = np.array([GROUND, 0.0]) - end
    far = np.linalg.norm(to)
    along = (COUPLER**2 - ROCKER**2 + far**2) / (2 * far)
    up = np.sqrt(COUPLER**2 - along**2)
    meet = end + along * to / far + up * np.array([-to[1], to[0]]) / far
    return float(np.arctan2(meet[1], meet[0] - GROUND))


def tool(q: float, crank: float = CRANK) -> Array:
    """(4, 4) of the tool."""
    angle = rocker(q, crank)
    out = np.eye(4)
    out[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    out[:2, 3] = [GROUND + 50 * np.cos(angle), 50 * np.sin(angle)]
    return out


@pytest.mark.parametrize("units", ["", "units: {length: m, angle: rad}\n"], ids=["mm, deg", "m, rad"])
def test_a_four_bar_linkage_goes_where_its_circles_meet(tmp_path: Path, units: str) -> None:
    machine, q = linkage(tmp_path, units=units), np.linspace(-1.3, 1.3, 7)
    column = q if "rad" in units else np.degrees(q)
    np.testing.assert_allclose(poses_of(machine, column), [tool(v) for v in q], atol=1e-9)


LOOP = f"""mechanism:
  type: graph
  bodies: [base, crank, bar, rocker, tip]
  flange: rocker
  joints:
    - {{name: q1, kind: revolute, parent: base, child: crank, actuated: true, range: [-80, 80]}}
    - {{name: mid, kind: revolute, parent: crank, child: bar, xyz: [{CRANK}, 0, 0]}}
    - {{name: rock, kind: revolute, parent: base, child: rocker, xyz: [{GROUND}, 0, 0]}}
    - {{name: pin, kind: fixed, parent: rocker, child: tip, xyz: [{ROCKER}, 0, 0]}}
    - {{name: shut, kind: revolute, parent: bar, child: tip, xyz: [{COUPLER}, 0, 0]}}
  home: {{rock: {np.degrees(rocker(0.0)):.3f}, mid: 45}}
frames: {{tool: {{in: flange, xyz: [50, 0, 0]}}}}
sensor: {{type: pose, sigma: {{xyz: 0.01, rot: 0.002}}}}
"""


def test_a_loop_may_carry_one_or_hold_one(tmp_path: Path) -> None:
    """Derivatives through the loop by bars of the formula and of the loop, against differences."""
    path = tmp_path / "loop.yaml"
    carried = (
        "    - {name: nod, kind: revolute, parent: tip, child: hand, xyz: [0, 0, 10], "
        "computed: 'sin(q1)*a', lengths: {a: 30}}\n"
    )
    ram = "    - {name: mid, kind: revolute, parent: crank, child: bar, xyz: [120, 0, 0]}\n"
    held = (
        "    - {name: ram, kind: prismatic, parent: crank, child: slid, axis: [1, 0, 0], "
        "computed: 'l + 5*sin(q1)', lengths: {l: 120}}\n"
        "    - {name: mid, kind: revolute, parent: slid, child: bar}\n"
    )
    text = LOOP.replace("  home:", carried + "  home:").replace("rocker, tip]", "rocker, tip, slid, hand]")
    text = text.replace("flange: rocker", "flange: hand").replace(ram.replace("120,", f"{CRANK},"), held)
    assert "ram" in text
    path.write_text(HEAD.format(units="") + text, encoding="utf-8")
    machine = load_machine(path)
    predictor = predictor_of(machine, np.array([-40.0, 15.0, 60.0]))
    p = predictor.model.p_home
    x, good = predictor.assemble(p)
    assert good.all()
    pose, twist = predictor.twists(p, x)
    names = list(predictor.model.names)
    for name in ("nod.a", "ram.l", "shut.x", "rock.x", "q1.offset"):
        k = names.index(name)
        step = 1e-5 * np.eye(len(p))[k]
        ends = [predictor.poses(p + sign * step)[0] for sign in (-1, 1)]
        slope = (ends[1] - ends[0]) / 2e-5
        np.testing.assert_allclose(twist[:, :3, k], slope[:, :3, 3], rtol=1e-5, atol=1e-5)
        turn = slope[:, :3, :3] @ pose[:, :3, :3].transpose(0, 2, 1)
        np.testing.assert_allclose(twist[:, 5, k], turn[:, 1, 0], rtol=1e-5, atol=1e-6)


def test_derivatives_are_those_of_sympy(tmp_path: Path) -> None:
    """By a bar's length, the crank's reading offset and the ground's, of the formula derived in SymPy."""
    machine = linkage(tmp_path)
    q = np.array([-0.7, 0.2, 0.9])
    predictor = predictor_of(machine, np.degrees(q))
    _, twist = predictor.twists(predictor.model.p_home, np.zeros((3, 0)))
    names = list(predictor.model.names)
    g, a, b, c, t, angle = sympy.symbols("g a b c t angle")
    far = sympy.sqrt((g - a * sympy.cos(angle)) ** 2 + (a * sympy.sin(angle)) ** 2)
    rock = sympy.pi - sympy.atan2(a * sympy.sin(angle), g - a * sympy.cos(angle))
    rock -= sympy.acos((c**2 + far**2 - b**2) / (2 * c * far))
    at = {g: GROUND, a: CRANK, b: COUPLER, c: ROCKER, t: 50.0}
    for symbol, name in ((a, "rock.a"), (b, "rock.b"), (c, "rock.c"), (g, "rock.g"), (angle, "q1.offset")):
        slope = sympy.diff(rock, symbol)
        for k, v in enumerate(q):
            expected = float(slope.subs(at | {angle: v}))
            turn = float(rock.subs(at | {angle: v}))
            found = twist[k][:, names.index(name)]
            across = 50 * expected * np.array([-np.sin(turn), np.cos(turn), 0.0])
            np.testing.assert_allclose(found, [*across, 0, 0, expected], atol=1e-10)


def test_a_bar_of_other_length_is_found_and_written_back(tmp_path: Path) -> None:
    rng, q = np.random.default_rng(3), np.linspace(-1.3, 1.3, 40)
    poses = np.array([tool(v, CRANK + 0.4) for v in q])
    turn = np.degrees([np.arctan2(pose[1, 0], pose[0, 0]) for pose in poses])
    table = pd.DataFrame({"q1": np.degrees(q)})
    for k, axis in enumerate("xyz"):
        table[axis] = poses[:, k, 3] + 0.01 * rng.standard_normal(40)
        table[f"r{axis}"] = (turn if axis == "z" else 0.0) + 0.002 * rng.standard_normal(40)
    found = calibrate(linkage(tmp_path, more="tolerances: {rock.a: 0.5}\n"), table)
    assert found.fit.prior.names[found.fit.prior.free[0]] == "rock.a"
    value, std = float(found.fit.p[found.fit.prior.free[0]]), float(found.fit.std[found.fit.prior.free[0]])
    assert abs(value - CRANK - 0.4) < 3 * std and std < 0.02
    write_calibrated(tmp_path / "calibrated.yaml", found.fit, found.recording)
    assert load_machine(tmp_path / "calibrated.yaml").geometry["rock.a"].nominal == pytest.approx(value)


def test_rows_where_the_formula_has_no_value_are_reported_and_left_out(tmp_path: Path) -> None:
    machine = linkage(tmp_path, "acos(q1/50)", more="tolerances: {rock.rz: 0.5}\n")
    q = np.linspace(-40.0, 70.0, 23)
    turn = np.degrees(np.arccos(np.minimum(q, 50.0) / 50.0))
    x, y = GROUND + 50 * np.cos(np.radians(turn)), 50 * np.sin(np.radians(turn))
    table = pd.DataFrame({"q1": q, "x": x, "y": y, "z": 0.0, "rx": 0.0, "ry": 0.0, "rz": turn})
    found = calibrate(machine, table)
    out = [
        note
        for note in found.notes
        if "the mechanism cannot be assembled there; the row was left out" in note
    ]
    assert len(out) == np.count_nonzero(q > 50.0)
    assert np.array_equal(found.fit.used, q <= 50.0)
    diagnosis = truepose.diagnose(machine, truepose.load_recording(machine, table))
    assert not diagnosis.findings


def test_a_sum_is_what_mimic_says(tmp_path: Path) -> None:
    q = np.array([-50.0, 10.0, 70.0])
    poses = [poses_of(linkage(tmp_path, law), q) for law in ("90 - 2*q1", "-q1*2 + 90.")]
    text = (tmp_path / "linkage.yaml").read_text(encoding="utf-8")
    start, end = text.index("computed:"), text.index("frames:")
    follows = f"{text[:start]}mimic: {{joint: q1, ratio: -2}}, offset: 90}}\n{text[end:]}"
    expected = poses_of(machine_from(tmp_path, follows, "mimic"), q)
    np.testing.assert_allclose(poses, [expected, expected], atol=1e-9)


@needs_compiler
def test_the_c_moves_it_too(tmp_path: Path) -> None:
    code = built_of(linkage(tmp_path), tmp_path / "c", "double")
    for angle in (-1.0, 0.3, 1.2):
        ended, moved = code.fk(np.array([angle]))
        assert ended == 0
        np.testing.assert_allclose(moved.reshape(3, 4), tool(angle)[:3], atol=1e-9)
        ended, out = code.ik(moved, np.array([angle + 0.02]))
        assert ended == 0
        np.testing.assert_allclose(out, [angle], atol=1e-8)


# -- formulas ------------------------------------------------------------------------------------------

NUMBERS = st.floats(0.1, 50.0).map(lambda v: repr(round(v, 3)))
TERMS = st.recursive(
    st.one_of(NUMBERS, st.sampled_from(["u", "v"])),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*"]), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
        inner.map(lambda t: f"sin({t})"),
        inner.map(lambda t: f"-{t}"),
        st.tuples(inner, inner).map(lambda t: f"atan2({t[0]}, {t[1]})"),
        inner.map(lambda t: f"sqrt(abs({t}))"),
    ),
    max_leaves=12,
)


@settings(deadline=None, max_examples=60)
@given(text=TERMS, u=st.floats(-3, 3), v=st.floats(0.1, 3))
def test_a_formula_means_what_sympy_reads_in_it(text: str, u: float, v: float) -> None:
    formula = Formula.read(text, ("u", "v"), 1.0, "test")
    found = float(ca.evalf(formula.value({"u": ca.SX(u), "v": ca.SX(v)})))
    own = {"u": sympy.Float(u), "v": sympy.Float(v), "abs": sympy.Abs, "sqrt": sympy.sqrt}
    expected = complex(sympy.sympify(text, locals=own).evalf())
    if abs(expected.imag) < 1e-12 and np.isfinite(found):
        # on its cut the sign is free
        assert found == pytest.approx(expected.real, rel=1e-9, abs=1e-9) or "atan2" in text


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ("q2 + 1", "joints[1].computed: found 'q2' in 'q2 + 1', expected a driven joint or a length"),
        ("sinn(q1)", "found 'sinn' in 'sinn(q1)', expected a function; did you mean 'sin' or 'asin'?"),
        ("q1^2", "found 'q1^2' in 'q1^2', expected ** for a power"),
        ("q1.real", "found 'q1.real' in 'q1.real', expected numbers, joints"),
        ("q1 +", "found 'q1 +', expected a formula such as 90 - q2 - q3"),
        ("atan2(q1)", "expected atan2 of 2 values"),
    ],
)  # fmt: skip
def test_what_is_no_formula_is_told_with_its_place(tmp_path: Path, law: str, said: str) -> None:
    with pytest.raises(InputError) as told:
        linkage(tmp_path, law)
    assert str(told.value).startswith(f"{tmp_path / 'linkage.yaml'}: mechanism.joints[1]")
    assert said in str(told.value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("lengths: {g:", "lengths: {x: 1, g:", "joints[1].lengths: found 'x', expected a name of letters and digits"),
        ("lengths: {g:", "lengths: {q1: 1, g:", "joints[1].lengths: found 'q1'"),
        ('computed: "', 'actuated: true, computed: "', "expected computed on a revolute or prismatic joint without"),
    ],
)  # fmt: skip
def test_lengths_and_joints_that_cannot_be_are_told(tmp_path: Path, old: str, new: str, said: str) -> None:
    linkage(tmp_path)
    text = (tmp_path / "linkage.yaml").read_text(encoding="utf-8")
    (tmp_path / "bad.yaml").write_text(text.replace(old, new), encoding="utf-8")
    with input_error(says=said):
        load_machine(tmp_path / "bad.yaml")
