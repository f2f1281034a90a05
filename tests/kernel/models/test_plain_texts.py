"""Machine files with characters that nobody sees: refused in one line, wherever they stand."""

from __future__ import annotations

import copy
import unicodedata
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truepose.errors import InputError
from truepose.models.file.machine_file import checked_machine
from truepose.models.file.names import check_text, hidden_character
from truepose.models.load import load_machine

HIDDEN = tuple("\x00\x07\x1b\n\r\t\x7f\x85\u200b\u200d\u202e\u2066\u2028\u2029\ufeff\ue000\xad")
DOCUMENT: dict[str, Any] = {
    "schema": "truepose/machine/1",
    "name": "arm",
    "mechanism": {
        "type": "serial",
        "joints": [
            {"name": "q1", "kind": "revolute", "r": 400},
            {"name": "q2", "kind": "revolute", "d": 150},
        ],
    },
    "masses": {"link": {"kg": 2.0, "com": [0, 0, 10], "in": "tool"}},
    "drivers": ["strain", {"name": "heat", "unit": "degC"}],
    "sensor": {"type": "points", "targets": {"ball": [1, 2, 3]}, "sigma": {"xyz": 0.01}},
    "effects": [{"effect": "actuator-scale", "place": ["q1"], "parameters": {"s": 0.0}}],
}
PLACES = (
    ("name",),
    ("masses",),
    ("mechanism", "joints", 0, "name"),
    ("mechanism", "type"),
    ("masses", "link"),
    ("masses", "link", "in"),
    ("drivers", 0),
    ("drivers", 1, "name"),
    ("drivers", 1, "unit"),
    ("sensor", "targets", "ball"),
    ("effects", 0, "effect"),
    ("effects", 0, "place", 0),
    ("effects", 0, "parameters", "s"),
)


def spoilt(place: tuple[str | int, ...], character: str) -> dict[str, Any]:
    """The document with a character in a text, or in the key of what is no text."""
    document = copy.deepcopy(DOCUMENT)
    inner: Any = document
    for part in place[:-1]:
        inner = inner[part]
    last = place[-1]
    if isinstance(inner[last], str):
        inner[last] += f"{character}x"
    else:
        inner[f"{last}{character}x"] = inner.pop(last)
    return document


@pytest.mark.parametrize("place", PLACES, ids=lambda place: ".".join(map(str, place)))
@pytest.mark.parametrize("character", HIDDEN, ids=lambda c: f"U+{ord(c):04X}")
def test_hidden_characters_are_refused_in_one_line(place: tuple[str | int, ...], character: str) -> None:
    with pytest.raises(InputError) as caught:
        checked_machine(Path("arm.yaml"), spoilt(place, character))
    said = str(caught.value)
    assert said.startswith("arm.yaml") and f"U+{ord(character):04X}" in said
    assert said.isascii() and said.isprintable()


@given(st.characters())
def test_what_is_refused_is_what_nobody_sees(character: str) -> None:
    hidden = unicodedata.category(character) in ("Cc", "Cf", "Cs", "Co", "Zl", "Zp")
    assert (hidden_character(f"a{character}b") is not None) == hidden
    if not hidden:
        assert check_text(f"a{character}b", "here") == f"a{character}b"


@pytest.mark.parametrize("name", ["Arm Süd", "机器人", "плечо", "a*/b", "%s", "'", '"'])
def test_letters_of_all_languages_are_names(name: str) -> None:
    document = copy.deepcopy(DOCUMENT)
    document["mechanism"]["joints"][0]["name"] = name
    assert checked_machine(Path("arm.yaml"), document).mechanism["joints"][0]["name"] == name


def test_a_formula_may_go_over_several_lines_and_hides_nothing() -> None:
    joint = {"name": "q3", "kind": "revolute", "computed": "90\n  - q1\n"}
    document = copy.deepcopy(DOCUMENT)
    document["mechanism"]["joints"].append(joint)
    checked_machine(Path("arm.yaml"), document)
    joint["computed"] = "90 - \u202eq1"
    with pytest.raises(InputError, match=r"joints\[2\]\.computed: found U\+202E"):
        checked_machine(Path("arm.yaml"), document)


@pytest.mark.parametrize("written", ["&#10;", "&#x202e;", "&#9;"])
def test_names_of_a_robot_description_are_checked_too(tmp_path: Path, written: str) -> None:
    (tmp_path / "arm.urdf").write_text(
        f"""<robot name="arm"><link name="a"/><link name="b"/>
        <joint name="turn{written}x" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="0" velocity="0"/></joint></robot>"""
    )
    (tmp_path / "arm.yaml").write_text(
        "schema: truepose/machine/1\nname: arm\n"
        "mechanism: {type: urdf, file: arm.urdf, base_link: a, tip_link: b}\n"
    )
    with pytest.raises(InputError, match=r"found U\+"):
        load_machine(tmp_path / "arm.yaml")
