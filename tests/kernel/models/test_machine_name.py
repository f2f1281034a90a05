"""A machine's name is one that its C can have: others are refused where the file is read, with the nearest that can."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from truepose.errors import InputError
from truepose.models.file.machine_file import checked_machine
from truepose.models.file.names import LONGEST, check_machine_name, nearest_name

JOINT = {"name": "q1", "kind": "revolute"}
ARM: dict[str, Any] = {"schema": "truepose/machine/1", "mechanism": {"type": "serial", "joints": [JOINT]}}


@given(st.text(max_size=200))
@example("while").via("a keyword")
@example("_a").via("reserved in C")
@example("7 $(odd)").via("begins with a digit")
@example("плечо").via("no letter of C")
@example("").via("no name at all")
def test_the_nearest_name_of_a_text_is_one_that_a_machine_may_have(text: str) -> None:
    found = nearest_name(text)
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", found) and found not in ("while", "int", "double")
    assert check_machine_name(found) == found
    if found != text:
        with pytest.raises(InputError) as refused:
            checked_machine(Path("arm.yaml"), ARM | {"name": text})
        said = str(refused.value)
        assert "name: " in said and (
            "only characters that are seen" in said or f"letter first: {found}" in said
        )


@pytest.mark.parametrize("name", ["arm", "UR5e", "doubles", "a" * LONGEST])
def test_a_name_that_c_can_have_stays_as_it_is_written(name: str) -> None:
    assert checked_machine(Path("arm.yaml"), ARM | {"name": name}).name == name == nearest_name(name)
