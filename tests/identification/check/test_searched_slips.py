"""Hypotheses whose size or order is searched for: a zero wherever it is, rows put back beside their readings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import truepose
from support.checked_arm import Document, document, recorded, written
from truepose.identification.check.kinds.joints import end_zeros, offset, zeros
from truepose.identification.check.kinds.order import matched
from truepose.identification.check.pair import Pair
from truepose.identification.check.rig import Rig
from truepose.identification.check.run import unbounded
from truepose.identification.check.slip import RARE, Slip

SEEN = ["x", "y", "z", "rx", "ry", "rz"]


@pytest.fixture(scope="module")
def right() -> pd.DataFrame:
    return recorded()


def rig_of(folder: Path, rows: pd.DataFrame, machine: Document | None = None) -> Rig:
    path, _ = written(folder, machine or document(), rows)
    loaded = truepose.load_machine(path)
    return Rig(loaded, truepose.load_recording(unbounded(loaded), rows))


def sizes(slips: list[Slip]) -> dict[str, float]:
    """Degrees that each joint's zero is said to be off by."""
    return {s.where[0]: float(s.says.split(" off by ")[1].removesuffix(" deg")) for s in slips}


def test_a_zero_is_found_wherever_it_is(right: pd.DataFrame, tmp_path: Path) -> None:
    """To the scatter of the arm's own errors; a zero elsewhere of any other joint is a worse hypothesis."""
    rig = rig_of(tmp_path, right[:12].assign(q4=right["q4"] + 37.0))
    found = list(zeros(rig, rig.scene))
    assert sizes(found)["q4"] == pytest.approx(-37.0, abs=0.5)
    assert all(s.odds == RARE for s in found)
    before = rig.stand().misfit
    after = {s.where[0]: rig.stand(s.change(rig.scene)).misfit for s in found}
    assert min(after, key=lambda name: after[name]) == "q4" and after["q4"] < 0.1 * before


def test_a_zero_of_an_end_is_a_turn_of_the_base_or_of_the_tool(right: pd.DataFrame, tmp_path: Path) -> None:
    rig = rig_of(tmp_path, right[:12].assign(q1=right["q1"] + 20.0, q6=right["q6"] - 50.0))
    first = list(end_zeros(rig, offset(rig, 5, np.radians(50.0)).change(rig.scene)))
    assert sizes(first) == {"q1": pytest.approx(-20.0, abs=1.0)}
    last = list(end_zeros(rig, offset(rig, 0, np.radians(-20.0)).change(rig.scene)))
    assert sizes(last) == {"q6": pytest.approx(50.0, abs=1.0)}


def test_rows_that_were_sorted_are_put_back(right: pd.DataFrame, tmp_path: Path) -> None:
    rows = right[:20]
    mixed = rows.copy()
    mixed[SEEN] = rows[SEEN].sort_values("y").to_numpy()
    rig = rig_of(tmp_path, mixed)
    (slip,) = matched(rig, rig.scene)
    assert slip.where == ("y",) and "sorted by y in some of the columns only" in slip.says
    there = slip.change(rig.scene)
    np.testing.assert_allclose(there.rows.observations["x"], rows["x"])
    mended = slip.mend(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"])).sheets[0]
    for name in (*SEEN, "q1", "q6"):
        np.testing.assert_allclose(mended.numbers(name), rows[name])


def test_rows_in_no_order_are_not_looked_at(right: pd.DataFrame, tmp_path: Path) -> None:
    rig = rig_of(tmp_path, right[:20])
    assert not list(matched(rig, rig.scene))
    few = rig_of(tmp_path, right[:7].sort_values("x"))
    assert not list(matched(few, few.scene))
    falling = rig_of(tmp_path, right[:20].assign(q2=np.linspace(50, -70, 20)))
    assert [s.where for s in matched(falling, falling.scene)] in ([], [("q2",)])


@pytest.mark.parametrize("out", [-165.0, 175.0])
def test_readings_are_brought_back_into_an_uneven_range(
    out: float, right: pd.DataFrame, tmp_path: Path
) -> None:
    """A range of 30 to 350 deg: what stands below or above it is a turn away."""
    machine = document()
    machine["mechanism"]["joints"][3]["range"] = [30.0, 350.0]
    read = np.linspace(40, 340, 12)
    read[3] = out
    rig = rig_of(tmp_path, right[:12].assign(q4=read), machine)
    mended = offset(rig, 3, np.radians(5.0)).mend(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"]))
    expected = read + 5.0
    expected[3] += 360.0 if out < 0 else 0.0
    if out > 0:  # inside as it is: nothing is out, the zero goes into the table
        assert mended.get(("mechanism", "joints", 3, "theta")) == pytest.approx(5.0)
        return
    np.testing.assert_allclose(mended.sheets[0].numbers("q4"), expected, atol=1e-9)
