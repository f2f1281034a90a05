"""Charts of the studies: the same bytes from the same numbers, text that stays text, all that was given is drawn."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

from challenge.studies import reliability
from proof_support import BENCHMARKS

figures = import_module("figures")
DRAW = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from figures import Series, write_bars, write_chart
folder = Path(sys.argv[2])
curves = [Series("a < b", [1.0, 2.0], [0.1, 10.0], "both", [0.05, 1.0]), Series("line", [1.0, 2.0], [3.0, 3.0])]
write_chart(folder / "chart.svg", "title", "x, mm", "y, um", curves, log_y=True)
write_bars(folder / "bars.svg", "bars", "um", ["first", "second"], [("mean", [1.0, 2.0]), ("most", [3.0, 4.0])])
"""


def test_another_process_writes_the_same_bytes_without_a_date(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        subprocess.run([sys.executable, "-c", DRAW, str(BENCHMARKS), str(folder)], check=True)
    for name, texts in {
        "chart.svg": ("title", "x, mm", "y, um", "a &lt; b", "line"),
        "bars.svg": ("bars", "first", "second", "mean", "most"),
    }.items():
        first, second = ((folder / name).read_bytes() for folder in folders)
        assert first == second
        drawn = re.findall(r"<text[^>]*>([^<]*)</text>", first.decode())
        assert set(texts) <= set(drawn)
        assert not re.search(rb"<dc:date>|\d{4}-\d\d-\d\dT", first)


def test_the_reliability_of_an_examination_is_drawn_from_its_table(tmp_path: Path) -> None:
    bins = [
        {"said": 0.3, "n": 4, "hits": 1, "interval": [0.05, 0.7]},
        {"said": 0.9, "n": 5, "hits": 5, "interval": [0.57, 1.0]},
    ]
    (tmp_path / "table.json").write_text(json.dumps({"reliability": {"names": bins}}))
    reliability.main(str(tmp_path), str(tmp_path / "r.svg"))
    text = (tmp_path / "r.svg").read_text()
    assert "share that was right" in text and "95 % Wilson interval" in text
    bins[0]["hits"] = 2
    (tmp_path / "table.json").write_text(json.dumps({"reliability": {"names": bins}}))
    reliability.main(str(tmp_path), str(tmp_path / "other.svg"))
    assert (tmp_path / "other.svg").read_text() != text
