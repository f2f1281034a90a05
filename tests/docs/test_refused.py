"""The page of what is refused names the limits as they are."""

from __future__ import annotations

import pytest

from support import ROOT
from truepose import files
from truepose.identification.leaves.programs import program
from truepose.models.builders import urdf_file
from truepose.models.file import limits, names
from truepose.models.leaves.starting import compiled_mjcf
from truepose.models.machine import placed

PAGE = (ROOT / "docs" / "reference" / "refused.md").read_text(encoding="utf-8")
SAID = {
    "ENTRIES": f"{limits.ENTRIES:,} values",
    "LARGEST": f"readings ... in mm, rad, kg | {limits.LARGEST:.0e}".replace("+", "") + " by size",
    "LATEST": f"such as `time` | {limits.LATEST:.0e}".replace("+", "") + " by size",
    "LEAST_GRAVITY": f"at least {limits.LEAST_GRAVITY:.0e}".replace("-06", "-6"),
    "NAMED": f"of one machine file | {limits.NAMED:,} |",
    "PARTS": f"of one mechanism | {limits.PARTS} |",
    "POSES": f"(`-n`) | {limits.POSES:,} |",
    "ROWS": f"of one file of a recording | {limits.ROWS:,};",
    "SMALLEST": f"{limits.SMALLEST:.0e} to {limits.LARGEST:.0e}".replace("+", ""),
}

ELSEWHERE = {
    "every file": f"every file that is read | {files.FILE_BYTES >> 30} GiB |",
    "URDF": f"URDF | {urdf_file.CHAIN_MOST} joints",
    "a machine": f"a machine's name | {names.LONGEST} characters that C can have in a name |",
    "names": f"names of {urdf_file.NAME_MOST} characters",
    "MuJoCo": f"{compiled_mjcf.SECONDS_MOST} s of the processor and {compiled_mjcf.MIB_MOST:,} MiB",
    "numbers of a URDF": f"numbers of a URDF, in m, rad, kg, and of a robot program | {urdf_file.FARTHEST:.0e}".replace(
        "+0", ""
    ),
    "numbers of a program": f"of a robot program | {program.LARGEST:.0e}".replace("+0", ""),
    "terms": f"(`degree`, `orders`, `waves`) | {placed.COUNT.high:g} |",
    "orders": f"(`first`, `orders`) | {placed.HARMONIC.high:g} |",
}


def test_every_limit_has_its_line() -> None:
    assert SAID.keys() == {name for name in vars(limits) if name.isupper()}


@pytest.mark.parametrize("said", ELSEWHERE.values(), ids=ELSEWHERE)
def test_so_have_the_limits_of_other_files(said: str) -> None:
    assert said in PAGE


@pytest.mark.parametrize("name", SAID)
def test_the_page_says_what_the_limit_is(name: str) -> None:
    assert SAID[name] in PAGE
