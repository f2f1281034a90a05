"""The law of corrected programs: run from their text, they bring the real arm where the drawn arm would have been.

Programs are drawn at random with waypoints in several roles, frames in frames and names that are assigned again; they are run
by an evaluator that shares no code with the product.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.examples import examples
from support.program_robots import difference, machine_file
from support.run_controller import Controller, stands
from support.run_programs import DRAWN, REAL, Node, functions, programs, written
from truepose.identification.leaves.programs.correct import Correction, correct
from truepose.identification.leaves.programs.dialects import DIALECTS
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

DIALECT_NAMES = ("urscript", "kuka", "rapid")


def check_law(dialect: str, text: str, found: Correction, taken: bool) -> int:
    """Assert that motions which are not listed end within 1 um; return how many there are."""
    listed = {one.line for one in found.left}
    wanted, sent = (Controller(dialect, one, taken).moved for one in (text, found.text))
    good = 0
    for was, now in zip(wanted, sent, strict=True):
        assert was.line == now.line
        np.testing.assert_array_equal(was.tool, now.tool)
        if was.line in listed:
            continue
        missed = difference(stands(now, REAL), was.pose)
        assert np.linalg.norm(missed[:3]) < 1e-3, f"line {was.line}: {missed}\n{text}\n{found.text}"
        assert np.linalg.norm(missed[3:]) < 1e-5
        good += 1
    return good


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
@settings(max_examples=examples(15), deadline=None)
@given(data=st.data())
def test_every_motion_ends_where_it_was_meant(machine: Machine, dialect: str, data: st.DataObject) -> None:
    nodes: list[Node] = data.draw(programs(dialect, blocks=False))
    text = written(dialect, nodes)
    found = correct(machine, DIALECTS[dialect].read(text, machine))
    count = check_law(dialect, text, found, taken=True)
    assert count == sum(node[0] == "move" for node in nodes)
    after = max(float(np.linalg.norm(one.after[:3])) for one in found.done)
    assert after < 1e-3


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
@settings(max_examples=examples(15), deadline=None)
@given(data=st.data())
def test_in_branches_and_loops_a_motion_ends_where_it_was_meant_or_is_listed(
    machine: Machine, dialect: str, data: st.DataObject
) -> None:
    text = written(dialect, data.draw(programs(dialect, blocks=True)))
    found = correct(machine, DIALECTS[dialect].read(text, machine))
    for taken in (True, False):
        check_law(dialect, text, found, taken)


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
@settings(max_examples=examples(25), deadline=None)
@given(data=st.data())
def test_with_a_function_a_motion_ends_where_it_was_meant_or_is_listed(
    machine: Machine, dialect: str, data: st.DataObject
) -> None:
    """Its parameter hides the waypoint of that name; base and tool may be set inside, and before each call."""
    name, body, main = data.draw(functions(dialect))
    text = written(dialect, main, (name, body))
    check_law(dialect, text, correct(machine, DIALECTS[dialect].read(text, machine)), taken=True)


@pytest.mark.parametrize("dialect", ["urscript", "kuka"])
@pytest.mark.parametrize("factor", ["wa", "wb"])
def test_a_name_that_may_hold_a_product_is_corrected_or_listed(
    machine: Machine, dialect: str, factor: str
) -> None:
    moved: Node = ("assign", "wa", ("product", ("name", "fc"), ("name", factor)))
    text = written(dialect, [("if", [moved]), ("move", ("name", "wa"))])
    found = correct(machine, DIALECTS[dialect].read(text, machine))
    for taken in (True, False):
        check_law(dialect, text, found, taken)


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
def test_without_a_correction_the_law_does_not_hold(dialect: str) -> None:
    text = written(dialect, [("move", ("name", "wa"))])
    (moved,) = Controller(dialect, text, True).moved
    assert np.linalg.norm(difference(stands(moved, REAL), moved.pose)[:3]) > 0.5
    assert np.linalg.norm(difference(stands(moved, DRAWN), moved.pose)[:3]) < 1e-6


COMPUTED = {
    "urscript": "movel(pose_add({}, step), a=1.2, v=0.25)",
    "kuka": "LIN {}:step",
    "rapid": "MoveL Offs({},step,0,0),v100,fine,t0\\WObj:=wobj0;",
}


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
def test_a_point_that_the_program_computes_is_listed(machine: Machine, dialect: str) -> None:
    text = written(dialect, [("move", ("name", "wa"))])
    motion = {"urscript": "movel(wa,", "kuka": "LIN wa", "rapid": "MoveL wa,"}[dialect]
    lines = text.splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith(motion))
    lines.insert(at, COMPUTED[dialect].format("wa"))
    found = correct(machine, DIALECTS[dialect].read("\n".join(lines), machine))
    (why,) = (one.why for one in found.left if one.line == at + 1)
    assert "worked out while the program runs" in why and found.done


@pytest.mark.parametrize(
    "constant", ["d2r({})", "-d2r(-{})", "{} / 180 * 3.14159265358979", "3.14159265358979*{}/180"]
)
def test_constants_that_are_worked_out_in_a_literal_are_its_numbers(machine: Machine, constant: str) -> None:
    degrees = np.degrees([0.35, 0.25, 0.3, 0.4, 0.9, 0.5])

    def script(numbers: list[str]) -> str:
        return f"set_tcp(p[0,0,0.1,{numbers[0]},0,0])\nmovej([{','.join(numbers)}])\n"

    plain = script([f"{np.radians(v):.10f}" for v in degrees])
    worked_out = script([constant.format(f"{v:.9f}") for v in degrees])
    one, other = (correct(machine, DIALECTS["urscript"].read(text, machine)) for text in (plain, worked_out))
    new, same = (re.findall(r"[-\d.]+", found.text.splitlines()[1]) for found in (one, other))
    np.testing.assert_allclose(np.array(same, dtype=float), np.array(new, dtype=float), atol=1e-7)
    assert other.text.splitlines()[0] == worked_out.splitlines()[0]


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return load_machine(machine_file(tmp_path_factory.mktemp("arm"), REAL))


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
def test_a_point_computed_from_a_parameter_is_left_to_its_calls(machine: Machine, dialect: str) -> None:
    main: list[Node] = [("move", ("name", "wa")), ("call", ("name", "wa"))]
    text = written(dialect, main, ("wa", [("move", ("name", "wa"))]))
    motion = {"urscript": "movel(wa,", "kuka": "LIN wa", "rapid": "MoveL wa,"}[dialect]
    lines = text.splitlines()
    head = next(k for k, line in enumerate(lines) if " go(" in line)
    assert lines[head + 1].startswith(motion)
    lines[head + 1] = COMPUTED[dialect].format("wa")
    found = correct(machine, DIALECTS[dialect].read("\n".join(lines), machine))
    assert any(one.line == head + 2 for one in found.left)
    assert found.text.splitlines()[head + 1] == lines[head + 1]
