"""The page of what is refused names the limits as they are."""

from __future__ import annotations

import pytest

from support import ROOT
from truepose.models import limits

PAGE = (ROOT / "docs" / "reference" / "refused.md").read_text(encoding="utf-8")
SAID = {
    "COLUMNS": f"columns of a recording | {limits.COLUMNS:,} |",
    "ENTRIES": f"{limits.ENTRIES:,} values",
    "FILE_BYTES": f"{limits.FILE_BYTES >> 20} MB",
    "LARGEST": f"readings ... in mm, rad, kg | {limits.LARGEST:.0e}".replace("+", "") + " by size",
    "LATEST": f"such as `time` | {limits.LATEST:.0e}".replace("+", "") + " by size",
    "LEAST_GRAVITY": f"at least {limits.LEAST_GRAVITY:.0e}".replace("-06", "-6"),
    "LINE": f"{limits.LINE:,} characters",
    "NAME": f"a machine's name | {limits.NAME} characters |",
    "NAMED": f"of one machine file | {limits.NAMED:,} |",
    "PARTS": f"of one mechanism | {limits.PARTS} |",
    "POSES": f"(`-n`) | {limits.POSES:,} |",
    "RECORDING_BYTES": f"one file of a recording | {limits.RECORDING_BYTES / 1e9:.1f} GB |",
    "ROWS": f"of one file of a recording | {limits.ROWS:,};",
    "SMALLEST": f"{limits.SMALLEST:.0e} to {limits.LARGEST:.0e}".replace("+", ""),
}


def test_every_limit_has_its_line() -> None:
    assert SAID.keys() == {name for name in limits.__all__ if name.isupper()}


@pytest.mark.parametrize("name", SAID)
def test_the_page_says_what_the_limit_is(name: str) -> None:
    assert SAID[name] in PAGE
