"""Mended YAML files: what they hold is what was asked, and what stays keeps its comments and layout."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support import ROOT
from support.examples import examples
from truepose.models.file.yaml_document import parse_document
from truepose.models.file.yaml_edit import edited_text

ARMS = sorted((ROOT / "models" / "leaves" / "starting" / "bundled_arms").glob("*.yaml"))
TEXT = """\
# the arm in the corner
name: arm  # its name
units: {length: mm}

joints:  # from the data sheet
  - {name: q1, theta: 0, range: [-170, 170]}  # the waist
  # the shoulder
  - {name: q2, theta: 1.0e-3, range: [-.inf, .inf]}
frames:
  base:
    xyz: [1, 2, 3]  # seen by the tracker
    note: "as built"
"""
VALUES = st.one_of(
    st.integers(-9, 9),
    st.floats(allow_nan=False),
    st.booleans(),
    st.none(),
    st.text("ab:# '\"-é", max_size=6),
)
DOCUMENTS = st.recursive(
    VALUES,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(st.sampled_from(["name", "units", "x", "xyz"]), inner, max_size=3),
    ),
    max_leaves=6,
)


def places(at: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Every place of a document below its root."""
    items = at.items() if isinstance(at, dict) else enumerate(at) if isinstance(at, list) else ()
    return [place for key, value in items for place in ((*path, key), *places(value, (*path, key)))]


@pytest.mark.parametrize("file", ARMS, ids=lambda file: file.stem)
def test_a_file_that_needs_no_change_stays_as_it_is(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert edited_text(text, parse_document(text, file)) == text


@settings(max_examples=examples(100))
@given(st.data())
def test_a_changed_file_holds_what_was_asked(data: st.DataObject) -> None:
    """Any place may become anything, be added or go."""
    document = copy.deepcopy(parse_document(TEXT, "arm.yaml"))
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.sampled_from(places(document)))
        at: Any = document
        for step in place[:-1]:
            at = at[step]
        if data.draw(st.booleans()):
            at[place[-1]] = data.draw(DOCUMENTS)
        elif isinstance(at, dict) and len(document) > 1:
            del at[place[-1]]
    assert parse_document(edited_text(TEXT, document), "arm.yaml") == document


def test_comments_and_layout_stay_beside_a_change() -> None:
    document = copy.deepcopy(parse_document(TEXT, "arm.yaml"))
    document["joints"][1]["theta"] = 0.25
    document["frames"]["base"]["xyz"][2] = -3.5
    document["gravity"] = [0.0, 0.0, -9.8]
    expected = TEXT.replace("1.0e-3", "0.25").replace("[1, 2, 3]  #", "[1, 2, -3.5] #")
    assert edited_text(TEXT, document) == expected + "gravity: [0.0, 0.0, -9.8]\n"
