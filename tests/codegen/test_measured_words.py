"""What measurements on a controller say, without one: tables, lines, sums over calls, stacks by the compiler's account."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support import MACHINES
from truepose.codegen.leaves.embedded import __main__ as program
from truepose.codegen.leaves.embedded import command as writing
from truepose.codegen.leaves.embedded.measure import Chain, Cost, Measurement, read_frames
from truepose.codegen.leaves.embedded.program import Compiler, Sizes, read_source
from truepose.codegen.leaves.embedded.section import sizes_section, summary, table
from truepose.codegen.leaves.embedded.toolchain import (
    CORTEX_M4F,
    CORTEX_M7,
    TARGETS,
    Observation,
    Toolchain,
    run,
    target_for,
)
from truepose.errors import InputError
from truepose.models.load import load_machine

TOOLS = Toolchain(Path("gcc"), Path("size"), Path("qemu"), "gcc 12", "qemu 8")


def cost(size: int, codes: tuple[int, ...] = (20, 0, 0, 0, 0)) -> Cost:
    """Every number of it tells which it is."""
    return Cost(codes, size + 1.6, size + 2.0, size + 3, size + 4, size + 5, size * 1e-9, size * 1e-12)


FAR = Observation("far", 0, 1, True, 123456, 0, 0.0, 0.0)
MEASURED = Measurement(
    name="arm",
    target=CORTEX_M7,
    optimisation="-O2",
    compiler="gcc 12",
    emulator="qemu 8",
    vectors=20,
    object=Sizes(12345, 6, 7),
    linked_ik=Sizes(22345, 16, 17),
    linked_fk=Sizes(1234, 26, 27),
    chain_ik=Chain((("arm_ik", 1000), ("solve", 234))),
    chain_fk=Chain((("arm_fk", 100),)),
    fk=cost(1000),
    warm=cost(2000, (19, 1, 0, 0, 0)),
    cold=cost(30000, (17, 1, 2, 0, 0)),
    jac=cost(4000),
    compensate=cost(5000),
    refused=(FAR,),
)  # fmt: skip


def test_a_table_has_a_column_for_each_measurement() -> None:
    small = replace(MEASURED, target=CORTEX_M4F, optimisation="-Os", cold=None)
    lines = table([MEASURED, small])
    assert lines[:2] == ["| | Cortex-M7, `-O2` | Cortex-M4F, `-Os` |", "|---|---|---|"]
    cells = {
        line.split(" | ")[0].removeprefix("| "): line.removesuffix(" |").split(" | ")[1:]
        for line in lines[2:]
    }
    assert cells["`arm_kin.o`: text, data, bss [B]"] == ["12,345, 6, 7"] * 2
    assert cells["linked for `arm_ik` alone, with its part of the C library [B]"][0] == "22,345, 16, 17"
    assert cells["linked for `arm_fk` alone [B]"][0] == "1,234, 26, 27"
    instructions = "instructions, mean, median, most"
    assert cells[f"`arm_ik` warm: {instructions}"] == ["2,002, 2,002, 2,003"] * 2
    assert cells[f"`arm_ik` cold: {instructions}"] == ["30,002, 30,002, 30,003", "none"]
    assert cells[f"`arm_fk`: {instructions}"][0] == "1,002, 1,002, 1,003"
    assert cells[f"`arm_jac`: {instructions}"][0] == "4,002, 4,002, 4,003"
    assert cells[f"`arm_compensate`: {instructions}"][0] == "5,002, 5,002, 5,003"
    assert cells["`arm_ik` out of reach, the longest: instructions"] == ["123,456"] * 2
    assert cells["`arm_ik` warm: stack, median and most [B]"][0] == "2,004, 2,005"
    assert cells["`arm_ik` cold: stack, median and most [B]"] == ["30,004, 30,005", "none"]
    assert cells["`arm_fk`, `arm_jac`, `arm_compensate`: stack, most [B]"][0] == "1,005, 4,005, 5,005"
    deepest = "`arm_ik`: stack reserved by its deepest calls, without the C library [B]"
    assert cells[deepest][0] == "1,234: `arm_ik` 1,000, `solve` 234"
    assert cells["calls that did not return 0: `arm_fk`, `arm_ik` warm, cold"] == ["0, 1, 3", "0, 1"]
    assert cells["largest error of `arm_fk`"][0] == "1.0e-06 mm, 1.0e-09 rad"
    assert cells["largest error of `arm_ik`, warm or cold"] == [
        "3.0e-05 mm, 3.0e-08 rad",
        "2.0e-06 mm, 2.0e-09 rad",
    ]
    assert len(cells) == 16


def test_what_remembers_is_in_the_table_where_all_have_it() -> None:
    whole = replace(MEASURED, state=cost(6000), state_object=Sizes(777, 8, 9))
    rows = table([whole])[-3:]
    assert rows == [
        "| `arm_state.o`: text, data, bss [B] | 777, 8, 9 |",
        "| `arm_state_update`: instructions, mean, median, most | 6,002, 6,002, 6,003 |",
        "| `arm_state_update`: stack, median and most [B] | 6,004, 6,005 |",
    ]
    for one in (MEASURED, replace(whole, state=None), replace(whole, state_object=None)):
        assert not any("state" in line for line in table([whole, one]))


def test_a_measurement_is_told_in_a_line_and_in_a_section() -> None:
    (line,) = summary([MEASURED])
    assert line == (
        "Cortex-M7 -O2: 12,345 B of code; an inverse takes 2,002 instructions warm, 30,003 at most cold, and 30,005 B of stack"
    )
    (line,) = summary([replace(MEASURED, cold=None)])
    assert line.endswith("an inverse takes 2,002 instructions warm, and 2,005 B of stack")
    deep = replace(MEASURED, warm=replace(MEASURED.warm, stack=40000))
    assert summary([deep])[0].endswith("and 40,000 B of stack")
    section = sizes_section([MEASURED])
    assert sizes_section([]) == "" and summary([]) == []
    assert section.startswith(
        "## Measured\n\nOn Cortex-M7, over the 20 test vectors. Warm: the guess of `arm_ik` stands\n"
    )
    assert "\n".join(table([MEASURED])) in section
    assert section.endswith(
        "Compiled by `gcc 12` with `-mcpu=cortex-m7 -mfpu=fpv5-d16 -mfloat-abi=hard -mthumb`,\n"
        "run by `qemu 8` (`-machine mps2-an500`).\n"
    )


def test_all_is_solved_where_every_call_is_and_nothing_else() -> None:
    good = replace(MEASURED, warm=cost(2000), cold=cost(30000))
    assert good.solved and replace(good, cold=None).solved
    brief = replace(FAR, instructions=5)
    assert good.longest == 123456 and replace(good, refused=(brief,)).longest == 30003
    failed = cost(1, (19, 1, 0, 0, 0))
    assert not replace(good, fk=failed).solved and not replace(good, warm=failed).solved
    assert not replace(good, cold=failed).solved and not replace(good, jac=failed).solved
    assert not replace(good, compensate=failed).solved
    for accepted in (replace(FAR, code=0), replace(FAR, kept=False)):
        assert not replace(good, refused=(FAR, accepted)).solved


def test_a_controller_computes_in_one_kind_of_number() -> None:
    assert target_for("double") is TARGETS["cortex-m7"] and target_for("float") is TARGETS["cortex-m4f"]
    for target in TARGETS.values():
        own, ends = (target.flash.origin, target.ram.origin), (target.flash.size, target.ram.size)
        assert own[0] + ends[0] <= own[1] and target.stack < target.ram.size
        promoted = "-Wdouble-promotion" in Compiler(TOOLS, target, "-Os").flags
        assert promoted is (target.real == "float")
        assert Compiler(TOOLS, target, "-Os").flags[-1] == "-Os"


NODE = 'node: {{ title: "{0}" label: "{0}\\n/x/kin.c:1:1\\n{1} bytes ({2})\\n0 dynamic objects" }}\n'
EDGE = 'edge: {{ sourcename: "{0}" targetname: "{1}" label: "kin.c:2:3" }}\n'


def callgraph(
    folder: Path, sizes: dict[str, int], calls: list[tuple[str, str]], kind: str = "static"
) -> Path:
    path = folder / "kin.ci"
    nodes = "".join(NODE.format(name, size, kind) for name, size in sizes.items())
    path.write_text(nodes + "".join(EDGE.format(*call) for call in calls), encoding="utf-8")
    return path


def test_the_deepest_chain_is_that_of_most_bytes_and_not_of_most_calls(tmp_path: Path) -> None:
    """Functions of other files take no room here; names are told as people wrote them."""
    sizes = {"ik": 10, "kin.c:solve.part.0": 100, "kin.c:a": 20, "kin.c:b": 30, "kin.c:c": 40}
    calls = [
        ("ik", "kin.c:a"),
        ("kin.c:a", "kin.c:b"),
        ("kin.c:b", "kin.c:c"),
        ("ik", "kin.c:solve.part.0"),
        ("ik", "sqrt"),
    ]
    found = read_frames(callgraph(tmp_path, sizes, calls))
    assert not found.indirect
    chain = found.deepest("ik")
    assert chain.frames == (("ik", 10), ("solve", 100)) and chain.size == 110
    assert found.deepest("kin.c:a").size == 90
    with pytest.raises(InputError, match="stack: found recursion a -> b -> a, expected none"):
        read_frames(callgraph(tmp_path, sizes, [*calls, ("kin.c:b", "kin.c:a")])).deepest("ik")
    assert read_frames(callgraph(tmp_path, sizes, [("ik", "__indirect_call")])).indirect
    with pytest.raises(InputError, match="ik: found a frame of dynamic size, expected a fixed one"):
        read_frames(callgraph(tmp_path, sizes, calls, "dynamic"))


def test_programs_that_fail_are_told_in_their_words() -> None:
    assert run(["sh", "-c", "echo said; echo more >&2"]).stdout == "said\n"
    with pytest.raises(InputError, match=r"^sh: failed with code 3: no message$"):
        run(["sh", "-c", "exit 3"])
    with pytest.raises(InputError, match=r"^gcc for it: failed with code 1: a b c d$"):
        run(["sh", "-c", "printf 'a\\nb\\nc\\nd\\ne\\n' >&2; echo out; exit 1"], doing="gcc for it")
    with pytest.raises(InputError, match=r"^sh: failed with code 1: out$"):
        run(["sh", "-c", "echo out; exit 1"])


def test_the_readme_and_the_program_have_the_section(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = list[str]()

    def measured(
        directory: Path, name: str | None = None, *, optimisation: str, tools: object = None
    ) -> Measurement:
        if not directory.is_dir():
            raise InputError(f"{directory}: found no files")
        asked.append(optimisation)
        return replace(MEASURED, optimisation=optimisation)

    monkeypatch.setattr(writing, "required", lambda: TOOLS)
    monkeypatch.setattr(writing, "measure", measured)
    out = tmp_path / "out"
    paths, found = writing.generate_measured(load_machine(MACHINES / "serial.yaml"), out)
    assert [m.optimisation for m in found] == asked == ["-O2", "-Os"]
    assert sorted(paths) == sorted(path for path in out.rglob("*") if path.is_file())
    readme = (out / "README.md").read_text(encoding="utf-8")
    assert readme.startswith("# ") and readme.endswith("\n\n" + sizes_section(found))
    source = read_source(out)
    assert source.real == "double" and source.joints.shape == (len(source.poses), len(source.units))
    turning = np.array([unit == "rad" for unit in source.units])
    span = np.ptp(source.joints, axis=0)
    np.testing.assert_allclose(
        source.aside, np.where(turning, np.minimum(np.radians(1.0), 0.02 * span), 0.005 * span)
    )
    assert source.far > 50 * np.abs(source.poses[:, 3::4]).max()

    monkeypatch.setattr(program, "measure", measured)
    asked.clear()
    assert program.main([str(out), "-O", "s"]) == 0
    assert asked == ["-Os"]
    assert capsys.readouterr().out == f"{out}\n\n{sizes_section([found[1]])}\n"
    assert program.main([str(out)]) == 0 and asked == ["-Os", "-O2", "-Os"]
    capsys.readouterr()
    assert program.main([str(tmp_path / "none")]) == 2
    assert capsys.readouterr().err == f"error: {tmp_path / 'none'}: found no files\n"
