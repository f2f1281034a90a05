"""The worked example runs, its page shows what it prints and what it says, and the story it tells is true."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support import ROOT
from support.documents import blocks
from support.generated_c import needs_compiler
from support.guides import shown

pytestmark = pytest.mark.nightly

PAGE, SCRIPT = ROOT / "docs" / "worked-example.md", ROOT / "examples" / "worked_example.py"


@pytest.fixture(scope="module")
def example() -> Any:
    return importlib.import_module("examples.worked_example")


@needs_compiler
def test_the_page_shows_what_the_example_prints(example: Any, tmp_path: Path) -> None:
    printed = "\n".join(example.story(tmp_path))
    said = "\n[...]\n".join(block.text for block in blocks(PAGE) if block.language == "text")
    assert shown(said, printed), printed
    assert len(said.split()) > 0.9 * len(printed.split())  # nothing is left out that does not fit the story


def test_the_page_s_code_is_that_of_the_example() -> None:
    lines = {line.strip() for line in SCRIPT.read_text(encoding="utf-8").splitlines()}
    for block in blocks(PAGE):
        if block.language in ("python", "yaml"):
            assert [line for line in block.text.splitlines() if line.strip() not in lines] == []


def test_the_machine_as_built_uses_nothing_of_truepose(example: Any) -> None:
    """Its tip stands where plane geometry says, and only the readings' scale and the arm's length differ."""
    lift, swing = np.array([10.0, -20.0]), np.array([0.0, 30.0])
    turned = 30.0 * example.SCALE * np.pi / 180
    expected = example.LENGTH * np.array([[1.0, 0.0], [np.cos(turned), np.sin(turned)]])
    np.testing.assert_allclose(example.tip(lift, swing), np.column_stack([expected, lift]), atol=1e-12)
    source = re.search(r"^def tip.*?^def ", SCRIPT.read_text(encoding="utf-8"), re.S | re.M)
    assert source and not re.search(r"truepose\.\w", source.group())
