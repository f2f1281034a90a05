"""Generated C on emulated controllers: it solves there what it solves here, and what it takes is counted right."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from emulated.measure import Measurement, measure, read_frames
from emulated.program import LONG_LOOP, Compiler, build, read_source
from emulated.section import table
from emulated.toolchain import TARGETS, Target, missing, observe, read_log, required, target_for

from proof_support import PROOF
from support.generated_machines import ARM, BODIES, HEAD, machine_of
from truepose.codegen.c import generate
from truepose.codegen.features import ALL, Features
from truepose.codegen.printer import Real
from truepose.errors import InputError
from truepose.models.load import load_machine

EFFECTS = """effects:
  - {effect: backlash, place: [q1], parameters: {b: {value: 4.0e-4, unit: rad}}}
  - {effect: friction-hysteresis, place: [q2], width: 0.03, parameters: {h: {value: 3.0e-4, unit: rad}}}
  - {effect: piezo-creep, place: [q2], t0: 2, parameters: {g: {value: 0.01, unit: "1"}}}
  - {effect: thermal-expansion, place: [link1], lag: 300, parameters: {alpha: {value: 1.2e-5, unit: 1/K}}}
"""
LACKS = missing()
needs_toolchain = pytest.mark.skipif(bool(LACKS), reason=f"found no {', no '.join(LACKS)}")
TICKS = 3.2
"""Of the boards' timers, an instruction: 128 ns by 40 ns."""
REALS: tuple[Real, ...] = ("double", "float")


@cache
def written(where: Path, name: str, real: Real) -> Path:
    """The directory of a machine's C: one of ``generated_machines``, or one that comes with truepose."""
    bundled = PROOF.parent / "models" / "machines" / name / "machine.yaml"
    directory = where / f"embedded_{name}_{real}"
    generate(machine_of(where, name) if name in BODIES else load_machine(bundled), directory, real)
    return directory


@cache
def measured(where: Path, name: str, real: Real) -> Measurement:
    return measure(written(where, name, real))


def allowed(directory: Path) -> tuple[float, float]:
    """Position (mm) and angle (rad) within which a pose counts as met (interface.md, section 5)."""
    source = read_source(directory)
    reach = max(300.0, float(np.max(np.linalg.norm(source.poses[:, 3::4], axis=1))))
    return (1e-6, 1e-9) if source.real == "double" else (2e-6 * reach, 2e-6)


def log(target: Target, turns: int, ticks: int, deep: int = 8) -> str:
    """What a run would say that saw ``turns`` of the known loop take ``ticks`` ticks, and two words ``deep`` bytes."""
    zeros = " ".join(["00" * (8 if target.real == "double" else 4)] * 2)
    calls = (
        f"nothing 0 0 1 {round(3 * TICKS)} 0",
        f"turn {turns} 0 1 {ticks} 0",
        f"dig 2 0 1 {round(12 * TICKS)} {deep}",
    )
    return "".join(f"{call} {zeros}\n" for call in calls) + "end\n"


both = pytest.mark.parametrize("real", REALS)
each_target = pytest.mark.parametrize("target", TARGETS.values(), ids=list(TARGETS))
LOOPS: dict[Real, str] = {"double": "rails", "float": "hybrid"}
"""A machine with loops in each precision; that whose legs carry weight takes long."""
CASES: list[tuple[str, Real]] = [(name, real) for real in REALS for name in ("arm", LOOPS[real])]
CASES += [("polisher", "double")]


@needs_toolchain
@pytest.mark.parametrize(("name", "real"), CASES)
def test_every_vector_is_solved_on_the_target(root_directory: Path, name: str, real: Real) -> None:
    found = measured(root_directory, name, real)
    position, rotation = allowed(written(root_directory, name, real))
    assert found.target.real == real
    assert found.solved, found
    assert found.vectors >= 20 and found.cold
    for cost in (found.fk, found.warm, found.cold):
        assert cost.codes == (found.vectors, 0, 0, 0, 0)
        assert cost.position <= position and cost.rotation <= rotation  # false of NaN too
    assert math.isfinite(found.jac.position) and math.isfinite(found.compensate.position)
    assert found.warm.instructions < found.cold.instructions < found.longest


@needs_toolchain
@both
def test_bad_input_is_refused_and_leaves_the_output(root_directory: Path, real: Real) -> None:
    for name in ("arm", LOOPS[real]):
        codes = {seen.what: seen.code for seen in measured(root_directory, name, real).refused}
        far = codes.pop("far")
        assert far in (1, 2)
        assert codes == dict.fromkeys(
            ("nan-fk", "nan-jac", "nan-compensate", "nan-guess", "nan-pose", "skewed"), 4
        )
        assert all(seen.kept for seen in measured(root_directory, name, real).refused)


@needs_toolchain
@both
def test_the_code_needs_no_memory_but_the_stack(root_directory: Path, real: Real) -> None:
    found = measured(root_directory, "arm", real)
    assert (found.object.data, found.object.bss) == (0, 0)
    assert 0 < found.linked_fk.text < found.linked_ik.text
    # calls write no more than their frames reserve, and some of the C library
    library = 1024
    assert found.cold
    assert found.chain_ik.frames[0][0] == "arm_ik"
    assert max(found.warm.stack, found.cold.stack) < found.chain_ik.size + library
    assert found.fk.stack < found.chain_fk.size + library
    for cost in (found.fk, found.warm, found.cold, found.jac, found.compensate):
        assert 0 < cost.stack < found.target.stack


@needs_toolchain
@each_target
def test_loops_and_stacks_of_known_size_are_counted_exactly(
    root_directory: Path, tmp_path: Path, target: Target
) -> None:
    source = read_source(written(root_directory, "arm", target.real))
    seen = observe(build(source, Compiler(required(), target, "-O2"), tmp_path), target, required())
    assert [call.instructions for call in seen if call.what == "nothing"] == [1]
    assert [call.instructions for call in seen if call.what == "skip"] == [5]
    turns = {call.number: call.instructions for call in seen if call.what == "turn"}
    assert turns == {n: 2 * n + 2 for n in (1, 2, 1000, LONG_LOOP)}
    assert {call.number: call.stack for call in seen if call.what == "dig"} == {
        n: 4 * n for n in (1, 2, 1000)
    }


@needs_toolchain
@both
def test_every_c_file_compiles_for_the_target_without_a_warning(
    root_directory: Path, tmp_path: Path, real: Real
) -> None:
    compiler = Compiler(required(), target_for(real), "-O2")
    files = sorted(written(root_directory, "arm", real).glob("*.c"))
    assert len(files) >= 2
    for file in files:
        compiler.compile(file, tmp_path / "out.o")
    program = build(read_source(files[0].parent), compiler, tmp_path)
    assert (b"__aeabi_d" in program.read_bytes()) <= (real == "double")  # no arithmetic in software
    (tmp_path / "slow.c").write_text(
        "float twice(float x);\nfloat twice(float x)\n{\n    return (float)(x * 2.5);\n}\n"
    )
    if real == "float":
        with pytest.raises(InputError, match="Werror=double-promotion"):
            compiler.compile(tmp_path / "slow.c", tmp_path / "out.o")


@needs_toolchain
def test_small_code_on_a_controller(root_directory: Path) -> None:
    """An arm of six joints: the way from a nearby guess in 4 kB, everything in 14; neither slower than what is not small."""
    text = HEAD.format(name="bare") + ARM.partition("masses:")[0]
    (root_directory / "bare.yaml").write_text(text, encoding="utf-8")
    machine, found = load_machine(root_directory / "bare.yaml"), {}
    for features in ("warm", "warm,cold,branches,p", ""):
        directory = root_directory / f"bare_{features}"
        generate(machine, directory, features=Features.of(features) if features else ALL)
        found[features] = measure(directory, optimisation="-Os")
    warm, every, plain = found.values()
    assert warm.cold is None and warm.solved and every.solved
    assert warm.linked_ik.text <= 4000 and every.linked_ik.text <= 14_000
    assert warm.linked_ik.data == every.linked_ik.data == 0
    assert max(warm.warm.median, every.warm.median) <= plain.warm.median
    assert max(warm.warm.stack, every.warm.stack) <= plain.warm.stack


@needs_toolchain
@both
def test_every_update_of_a_state_takes_the_same_time(root_directory: Path, real: Real) -> None:
    (root_directory / "mem.yaml").write_text(HEAD.format(name="mem") + ARM.partition("masses:")[0] + EFFECTS)
    generate(load_machine(root_directory / "mem.yaml"), root_directory / f"mem_{real}", real)
    found = measure(root_directory / f"mem_{real}")
    assert found.state and found.state_object
    assert found.state.codes == (found.vectors, 0, 0, 0, 0)
    assert found.state.most <= 1.05 * found.state.median  # a maximum takes one instruction or another
    assert (found.state_object.data, found.state_object.bss) == (0, 0)
    assert "mem_state_update`: instructions" in "".join(table([found]))


@each_target
def test_a_run_that_counts_wrongly_is_refused(target: Target) -> None:
    right = round(
        (2 * 500 + 2 + 2) * TICKS
    )  # two more: the branch to it, and the second reading of the timer
    assert read_log(log(target, 500, right), target)[1].instructions == 1002
    for ticks in (right - 3, right + 3):
        with pytest.raises(InputError, match=r"found \(100[13], 0\) instructions .*expected \(1002, 0\)"):
            read_log(log(target, 500, ticks), target)
    with pytest.raises(InputError, match=r"expected \(10, 8\)"):
        read_log(log(target, 500, right, deep=12), target)
    with pytest.raises(InputError, match="no end of the stack"):
        read_log(log(replace(target, stack=1000), 500, right), replace(target, stack=1000))
    with pytest.raises(InputError, match=r"found \['fault'\] as the last line of the run, expected 'end'"):
        read_log("nothing 0 0 1 9 0 00 00\nfault\n", target)


def test_the_deepest_chain_of_calls(tmp_path: Path) -> None:
    sizes = {"a": 16, "k.c:b.part.0": 100, "k.c:c": 40, "k.c:d": 70}
    calls = [
        ("a", "k.c:b.part.0"),
        ("a", "k.c:c"),
        ("k.c:c", "k.c:d"),
        ("k.c:c", "sin"),
        ("k.c:b.part.0", "sin"),
    ]
    graph = tmp_path / "k.ci"

    def write(more: str = "", kind: str = "static") -> None:
        nodes = [
            f'node: {{ title: "{n}" label: "{n}\\nk.c:1:1\\n{s} bytes ({kind})" }}\n'
            for n, s in sizes.items()
        ]
        edges = [f'edge: {{ sourcename: "{a}" targetname: "{b}" label: "k.c:2:2" }}\n' for a, b in calls]
        graph.write_text("".join([*nodes, *edges, more]))

    write('node: { title: "sin" label: "sin\\nmath.h:88:15" shape : ellipse }\n')
    frames = read_frames(graph)
    assert frames.deepest("a").frames == (("a", 16), ("c", 40), ("d", 70))
    assert frames.deepest("a").size == 126
    assert frames.deepest("k.c:b.part.0").frames == (("b", 100),)
    assert not frames.indirect
    write('edge: { sourcename: "k.c:d" targetname: "__indirect_call" }\n')
    assert read_frames(graph).indirect
    write('edge: { sourcename: "k.c:d" targetname: "k.c:c" }\n')
    with pytest.raises(InputError, match="found recursion c -> d -> c, expected none"):
        read_frames(graph).deepest("a")
    write(kind="dynamic,bounded")
    with pytest.raises(InputError, match="a: found a frame of dynamic,bounded size, expected a fixed one"):
        read_frames(graph)
