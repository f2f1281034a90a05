"""A drift written down: which files, and what stands in them beside the result."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from support.reports import own_markup
from support.told_drift import CHANGED, DAY, movement, told_drift
from truepose.identification.leaves.drift.showing import MOVEMENTS, write_drift
from truepose.identification.load import Caution
from truepose.shown.result import frame

DOUBT = Caution("suspect", ("SUSPECT: sign: q2 counts backwards",), {"check": {"found": [{"kind": "sign"}]}})


def document(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text("utf-8")))


def cautious(page: Path) -> bool:
    """Whether the doubt stands in the page."""
    return "q2 counts backwards" in own_markup(page.read_text("utf-8"))


def test_a_drift_is_two_files_with_the_doubts_of_a_check(tmp_path: Path) -> None:
    moved = told_drift(movement("a", "moved", **CHANGED))
    for name, check in (("bare", None), ("calm", Caution()), ("doubt", DOUBT)):
        assert write_drift(moved, tmp_path / name, check) == ["drift.json", "report.html"]
        told = document(tmp_path / name / "drift.json")
        assert told["moved"] == ["a"] and ("check" in told) is (name == "doubt")
        assert cautious(tmp_path / name / "report.html") is (name == "doubt")
    told = document(tmp_path / "doubt" / "drift.json")
    assert told["check"] == json.loads(json.dumps(DOUBT.document["check"]))
    paths = moved.save(tmp_path / "whole")
    assert paths == [tmp_path / "whole" / name for name in ("drift.json", "report.html")]
    page = moved.report(tmp_path / "page.html")
    assert page.read_bytes() == (tmp_path / "whole" / "report.html").read_bytes()


def test_a_movement_is_told_up_to_the_last_session() -> None:
    changed = {**CHANGED, "std": (0.0, 0.002, 0.001)}
    moved = movement("a", "moved", extrinsic=True, hidden=0.5, steady=False, **changed)
    still = movement("b", "still", hidden=0.002, probability=0.03)
    table = frame(told_drift(moved, still)).set_index("parameter")
    assert list(table.columns) == MOVEMENTS[1:]
    assert table.loc["a"].to_dict() == {
        "status": "moved", "probability": 0.99, "change": 0.06, "std": 0.001, "unit": "mm", "rate": 0.02 / DAY,
        "rate_std": 0.001 / DAY, "steady": False, "hidden": 0.5, "extrinsic": True,
    }  # fmt: skip
    assert table.loc["b", ["change", "std", "rate", "rate_std"]].isna().all()
    assert (table.loc["b", "hidden"], table.loc["b", "probability"]) == (0.002, 0.03)
