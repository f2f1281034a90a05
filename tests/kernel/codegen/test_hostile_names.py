"""Names of a stranger in generated texts: whatever a machine file may call its parts, the C has the same tokens."""

from __future__ import annotations

import ast
import csv
import io
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from support.examples import examples
from support.generated_c import COMPILER, WARNINGS, needs_compiler
from truepose.codegen.c import generate, render
from truepose.codegen.texts import c_string, code_span, comment, markdown, python_string
from truepose.errors import InputError
from truepose.models.file.machine_file import checked_machine
from truepose.models.load import build_machine
from truepose.models.machine.machine import Machine

CPP = shutil.which("g++")
PLAIN = ("q1", "q2", "strain", "link")
"""What a machine file calls two joints, a driver and a mass."""
HOSTILE = (
    "*/ int main(void) { return 1; } /*", "??/", "*??/", "??=include <x>", "a\\", '"; }',
    "'", "%s%n", "/*", "//", "/", "*",
    "a|b", "`", "{{ 7 * 7 }}", "{% raw %}", "${HOME}", "$(touch x)",
    "<script>", "#define real int", "ärm µ ∑", "\U0001f916", "int", "class",
    "NAN", "INFINITY", "errno", "main", "sin", "real",
    "p0", "x" * 200, "=1+1",
)  # fmt: skip
_LITERAL = re.compile(r'"(?:\\.|[^"\\\n])*"')
_TOKEN = re.compile(
    r'"(?:\\.|[^"\\\n])*"|(?:\d|\.\d)(?:[eE][+-]|[\w.])*|[A-Za-z_]\w*|[-+*/%&|^<>=!]=|&&|\|\||<<|>>|\+\+|--|->|::|##'
    r"|[-+*/%&|^<>=!~?:;,.(){}\[\]#]|\n"
)


def machine(names: tuple[str, ...], name: str = "arm") -> Machine:
    """An arm of two joints whose parts are called as ``names`` say. Raises InputError for what no file may say."""
    first, second, driver, mass = names
    joints = [
        {"name": first, "kind": "revolute", "r": 400, "range": [-170, 170]},
        {"name": second, "kind": "revolute", "alpha": 90, "d": 150, "range": [-90, 90]},
    ]
    document: dict[str, Any] = {
        "schema": "truepose/machine/1",
        "name": name,
        "mechanism": {"type": "serial", "joints": joints},
        "frames": {"tool": {"in": "flange", "xyz": [300, 0, 40], "rpy": [0, 0, 0]}},
        "gravity": [0, 0, -9.81],
        "masses": {mass: {"kg": 2.0, "com": [0, 0, 10], "in": "tool", "tolerance": {"kg": 0.1}}},
        "drivers": [{"name": driver, "unit": "degC", "drives": "temperature"}],
        "effects": [
            {
                "effect": "empirical",
                "place": [first],
                f"from.{driver}": 10,
                f"to.{driver}": 30,
                "parameters": {"c1": {"value": 1e-3, "unit": "rad"}},
            },
            {"effect": "backlash", "place": [second]},
        ],
    }
    return build_machine(checked_machine(Path("arm.yaml"), document))


def texts(names: tuple[str, ...]) -> dict[str, str]:
    return render(machine(names), "double")


@cache
def plain_texts() -> dict[str, str]:
    return texts(PLAIN)


def spliced(text: str) -> str:
    """What a compiler that knows trigraphs reads: these, then lines that a backslash joins."""
    for mark, letter in zip("=/'()!<>-", "#\\^[]|{}~", strict=True):
        text = text.replace(f"??{mark}", letter)
    return text.replace("\\\n", "")


def bare(text: str) -> str:
    """The text of C without its comments, read as a compiler reads it."""
    return re.sub(
        r'("(?:\\.|[^"\\\n])*")|/\*.*?\*/|//[^\n]*',
        lambda found: found[1] or " ",
        spliced(text),
        flags=re.DOTALL,
    )


def tokens(text: str) -> list[str]:
    """Tokens of C without comments; places in p and z are one token, whatever they are called, and so are strings."""
    line = bare(text)
    rest = re.sub(r"[ \t]", "", _TOKEN.sub("", line))
    assert rest == "", rest
    found = [re.sub(r"^arm_[PZS]_\w+$", "arm_PLACE", token) for token in _TOKEN.findall(line)]
    return [_LITERAL.sub('""', token) if "arm_" not in token else token for token in found]


def code_of(written: dict[str, str]) -> dict[str, str]:
    return {file: text for file, text in written.items() if file.endswith((".c", ".h", ".hpp"))}


words = st.one_of(
    st.sampled_from(HOSTILE),
    st.text("*/?\\\"'%`|{}<>#= \t_aZ0ä", min_size=1, max_size=12),
    st.text(min_size=1, max_size=8),
)
called = st.tuples(words, words, words, words)


@settings(max_examples=examples(25))
@given(called)
@example(HOSTILE[:4])
@example(HOSTILE[4:8])
@example(HOSTILE[8:12])
@example(HOSTILE[14:18])
@example(HOSTILE[18:22])
def test_names_never_change_the_tokens_of_the_code(names: tuple[str, ...]) -> None:
    try:
        written = texts(names)
    except InputError:
        assume(False)
    for file, text in code_of(written).items():
        assert all(" " <= letter <= "~" or letter == "\n" for letter in text), file
        assert "??" not in text
        assert tokens(text) == tokens(plain_texts()[file]), file
    assert written["CMakeLists.txt"] == plain_texts()["CMakeLists.txt"]


@pytest.mark.nightly
@settings(max_examples=examples(25))
@given(called)
@example(HOSTILE[4:8])
def test_python_and_the_test_vectors_have_the_names_as_they_are(names: tuple[str, ...]) -> None:
    try:
        made = machine(names)
    except InputError:
        assume(False)
    written = render(made, "double")
    wrapper = written["wrappers/arm_kin.py"]
    assert wrapper.isascii()
    found = {
        node.target.id: ast.literal_eval(node.value)
        for node in ast.parse(wrapper).body
        if isinstance(node, ast.AnnAssign)
        and isinstance(node.target, ast.Name)
        and node.value is not None
        and node.target.id in ("JOINTS", "PARAMETERS", "DRIVERS")
    }
    assert tuple(found["JOINTS"]) == made.mechanism.readings == names[:2]
    assert f"{names[3]}.kg" in found["PARAMETERS"]
    head = next(csv.reader(io.StringIO(written["test_vectors.csv"], newline="")))
    assert head[:2] == list(names[:2])
    plain = ast.dump(ast.parse(plain_texts()["wrappers/arm_kin.py"]))
    assert _without_strings(ast.dump(ast.parse(wrapper))) == _without_strings(plain)


def _without_strings(dumped: str) -> str:
    return re.sub(r"value='(?:\\.|[^'\\])*'|value=\"(?:\\.|[^\"\\])*\"", "value=TEXT", dumped)


@needs_compiler
@pytest.mark.parametrize("at", range(0, len(HOSTILE), 4))
def test_hostile_names_compile_with_every_warning_an_error(tmp_path: Path, at: int) -> None:
    assert COMPILER is not None
    names = (HOSTILE + HOSTILE)[at : at + 4]
    generate(machine(names), tmp_path)
    strict = [*WARNINGS, "-trigraphs", "-Wtrigraphs"]
    compiled(tmp_path, [COMPILER, *strict, "-fsyntax-only", "arm_kin.c", "arm_batch.c", "example.c"])
    if CPP is not None:
        cpp = ["-std=c++17", "-trigraphs", *WARNINGS[1:], "-I.", "-fsyntax-only", "-x", "c++"]
        compiled(tmp_path, [CPP, *cpp, "wrappers/arm_kin.hpp"])


@needs_compiler
@pytest.mark.parametrize(
    "name", ["class", "NAN", "main", "errno", "sin", "real", "std", "NQ", "p", "M", "a" * 63]
)
def test_a_machine_may_be_called_like_words_of_c_and_its_libraries(tmp_path: Path, name: str) -> None:
    assert COMPILER is not None
    generate(machine(PLAIN, name), tmp_path)
    compiled(
        tmp_path, [COMPILER, *WARNINGS, "-fsyntax-only", f"{name}_kin.c", f"{name}_batch.c", "example.c"]
    )
    if CPP is not None:
        (tmp_path / "main.cpp").write_text(f'#include "wrappers/{name}_kin.hpp"\n')
        compiled(tmp_path, [CPP, "-std=c++17", *WARNINGS[1:], "-I.", "-fsyntax-only", "main.cpp"])


@needs_compiler
def test_strings_of_c_hold_what_was_said(tmp_path: Path) -> None:
    assert COMPILER is not None
    said = [*HOSTILE, "??/??/", "1\x002", "\x1b[2J", "a\nb", "\u202eevil\u202c", "7\x017", "???????"]
    lines = "".join(f"    {c_string(text)},\n" for text in said)
    source = (
        f"#include <stdio.h>\nint main(void)\n{{\n    static const char *const t[] = {{\n{lines}    }};\n"
    )
    source += "".join(
        f"    fwrite(t[{k}], 1, {len(text.encode())}, stdout);\n" for k, text in enumerate(said)
    )
    (tmp_path / "t.c").write_text(f"{source}    return 0;\n}}\n", encoding="ascii")
    compiled(tmp_path, [COMPILER, *WARNINGS, "-trigraphs", "t.c", "-o", "t"])
    told = subprocess.run([tmp_path / "t"], capture_output=True, check=True).stdout
    assert told == "".join(said).encode()


@given(st.text())
@example("*/")
@example("*??/\n/")
@example("**//")
def test_a_comment_never_ends_before_its_end(text: str) -> None:
    for body in (f"/* {comment(text)} */", f"/* [{comment(text)}]\n   more */"):
        assert bare(body).strip() == ""
        assert spliced(body).count("*/") == 1 and spliced(body).count("/*") == 1
        assert body.isascii()


@given(st.text())
def test_strings_of_python_hold_what_was_said(text: str) -> None:
    assert ast.literal_eval(python_string(text)) == text
    assert python_string(text).isascii()


@given(st.text())
@example("<script>alert(1)</script>")
@example("`<b>`")
def test_markdown_has_no_markup_of_others(text: str) -> None:
    for line in (markdown(text), code_span(text)):
        outside = re.sub(r"(?<!\\)`[^`|\n]*`", "", line)
        assert "<" not in outside and "\n" not in line
        assert not re.search(r"(?<!\\)(?:\\\\)*[`|*\[\]]", outside)


def compiled(folder: Path, command: list[str]) -> None:
    made = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace", check=False)
    assert made.returncode == 0, made.stderr
