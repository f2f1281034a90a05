"""Generated C on emulated controllers: it solves there what it solves here, and what it takes is counted right."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from support.command import input_error, refused, run
from support.embedded import REALS, TICKS, allowed, log, measured, needs_toolchain, written
from support.generated_machines import ARM, HEAD, machine_of
from support.machine_texts import machine_from
from truepose.codegen.c import generate
from truepose.codegen.features import ALL, Features
from truepose.codegen.leaves.embedded.measure import measure, read_frames
from truepose.codegen.leaves.embedded.program import LONG_LOOP, Compiler, build, read_source
from truepose.codegen.leaves.embedded.toolchain import (
    CORTEX_M4F,
    TARGETS,
    Target,
    missing,
    observe,
    read_log,
    required,
    target_for,
    toolchain,
)
from truepose.codegen.printer import Real

pytestmark = pytest.mark.nightly

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
        calls = ("nan-fk", "nan-jac", "nan-compensate", "nan-guess", "nan-pose", "skewed")
        assert codes == dict.fromkeys(calls, 4)
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
def test_measuring_again_gives_the_same_numbers(root_directory: Path) -> None:
    first = measured(root_directory, "arm", "double")
    assert measure(written(root_directory, "arm", "double")) == first
    small = measure(written(root_directory, "arm", "double"), optimisation="-Os")
    assert small.solved and small.object != first.object


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
        with input_error("Werror=double-promotion"):
            compiler.compile(tmp_path / "slow.c", tmp_path / "out.o")


@needs_toolchain
def test_a_warning_is_an_error_that_tells_the_compilers_words(root_directory: Path, tmp_path: Path) -> None:
    shutil.copytree(written(root_directory, "arm", "double"), tmp_path, dirs_exist_ok=True)
    code = tmp_path / "arm_kin.c"
    code.write_text(code.read_text() + "\nstatic int unused(void)\n{\n    return 1;\n}\n")
    with input_error(r"arm-none-eabi-gcc for Cortex-M7: failed with code 1: .*unused"):
        measure(tmp_path)


@needs_toolchain
def test_a_target_for_other_numbers_is_refused(root_directory: Path) -> None:
    with input_error("found C in double, expected float for Cortex-M4F"):
        measure(written(root_directory, "arm", "double"), target=CORTEX_M4F)


@needs_toolchain
def test_the_command_states_the_measurements_only_when_asked(tmp_path: Path) -> None:
    machine_of(tmp_path, "scara")
    plain, told = (tmp_path / name for name in ("plain", "told"))
    for out in ((plain,), (told, "--measure")):
        run("codegen", tmp_path / "scara.yaml", "--real", "float", "-o", *out)
    files = {file.relative_to(plain) for file in plain.rglob("*") if file.is_file()}
    assert files == {file.relative_to(told) for file in told.rglob("*") if file.is_file()}
    for file in files:
        same = (plain / file).read_bytes() == (told / file).read_bytes()
        assert same == (file != Path("README.md")), file
    before, section = (told / "README.md").read_text().split("\n## Measured\n")
    assert before == (plain / "README.md").read_text()
    tools = required()
    for said in (tools.compiler, tools.emulator, "`-O2`", "`-Os`", "Cortex-M4F", "stack"):
        assert said in section


def test_without_the_toolchain_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    machine_of(tmp_path, "scara")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert toolchain() is None
    assert missing() == [
        "arm-none-eabi-gcc (gcc-arm-none-eabi)",
        "arm-none-eabi-size (binutils-arm-none-eabi)",
        "qemu-system-arm (qemu-system-arm)",
    ]
    said = refused("codegen", tmp_path / "scara.yaml", "-o", tmp_path / "out", "--measure")
    assert said.startswith("error: measuring: found no arm-none-eabi-gcc (gcc-arm-none-eabi)")
    assert not (tmp_path / "out").exists()


@each_target
def test_a_run_that_counts_wrongly_is_refused(target: Target) -> None:
    # two more: the branch to it, and the second reading of the timer
    right = round((2 * 500 + 2 + 2) * TICKS)
    assert read_log(log(target, 500, right), target)[1].instructions == 1002
    for ticks in (right - 3, right + 3):
        with input_error(r"found \(100[13], 0\) instructions .*expected \(1002, 0\)"):
            read_log(log(target, 500, ticks), target)
    with input_error(r"expected \(10, 8\)"):
        read_log(log(target, 500, right, deep=12), target)
    with input_error("no end of the stack"):
        read_log(log(replace(target, stack=1000), 500, right), replace(target, stack=1000))
    with input_error(r"found \['fault'\] as the last line of the run, expected 'end'"):
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
    with input_error("found recursion c -> d -> c, expected none"):
        read_frames(graph).deepest("a")
    write(kind="dynamic,bounded")
    with input_error("a: found a frame of dynamic,bounded size, expected a fixed one"):
        read_frames(graph)


def test_a_directory_that_is_not_generated_is_refused(tmp_path: Path) -> None:
    with input_error(r"found 0 files NAME_kin\.h, expected one of generated C"):
        read_source(tmp_path)
    (tmp_path / "a_kin.h").write_text("typedef double a_real;\n")
    with input_error("expected type, number and units of the joints"):
        read_source(tmp_path)
    header = "      0  q1 [rad]\n   p: parameters\n4  [R|p] */\ntypedef double a_real;\n#define a_N 1 /* joints */\n"
    (tmp_path / "a_kin.h").write_text(header)
    with input_error(r"test_vectors\.csv: cannot read the test vectors"):
        read_source(tmp_path)
    (tmp_path / "test_vectors.csv").write_text("q1,T0\n1.0,nan\n")
    with input_error(r"found a table \(1, 2\), expected 13 finite numbers a row"):
        read_source(tmp_path)
    (tmp_path / "b_kin.h").write_text(header)
    with input_error("found 2 files"):
        read_source(tmp_path)


@needs_toolchain
def test_small_code_on_a_controller(root_directory: Path) -> None:
    """An arm of six joints: the way from a nearby guess in 4 kB, everything in 14; neither slower than what is not small."""
    text = HEAD.format(name="bare") + ARM.partition("masses:")[0]
    machine, found = machine_from(root_directory, text, "bare"), {}
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
@pytest.mark.parametrize("real", REALS)
def test_every_update_of_the_state_takes_the_same_time_on_a_controller(
    root_directory: Path, real: Real
) -> None:
    play = "effects: [{effect: backlash, place: [q1], parameters: {b: {value: 4.0e-4, unit: rad}}}]\n"
    generate(
        machine_from(
            root_directory, HEAD.format(name="play") + ARM.partition("masses:")[0] + play, f"play_{real}"
        ),
        root_directory / f"play_{real}",
        real,
    )
    found = measure(root_directory / f"play_{real}")
    assert found.state and found.state_object
    assert found.state.codes == (found.vectors, 0, 0, 0, 0)
    assert found.state.most <= 1.05 * found.state.median  # a maximum takes one instruction or another
    assert (found.state_object.data, found.state_object.bss) == (0, 0)
