"""Load-side encoders against their joints: what a column may be instead, in words and mended; zeros on both sides of limits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

import truepose
from support.checked_arm import Document, written
from truepose.identification.leaves.check.load_side import encoders
from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.result import Found

ROWS = 20


GANTRY: Document = yaml.safe_load("""
schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints:
    - {name: q1, kind: prismatic, r: 10}
    - {name: q2, kind: revolute, alpha: -90, d: 200}
    - {name: q3, kind: revolute, d: 300}
tolerances: {length: 0.2, angle: 0.05}
""")
"""A slide and two turning joints; mm, deg."""


def encoder(tolerance: float = 0.02, sigma: float = 0.001, **more: Any) -> Document:
    """An encoder on each joint."""
    both = {
        "tolerance": {"angle": tolerance, "length": tolerance},
        "sigma": {"angle": sigma, "length": sigma},
    }
    return {"type": "angle", **both, **more}


def rows(scatter: float = 0.0) -> pd.DataFrame:
    rng = np.random.default_rng(3)
    q = rng.uniform([-200.0, -150.0, -90.0], [200.0, 150.0, 90.0], (ROWS, 3))
    read = q + scatter * rng.standard_normal(q.shape)
    names = ["q1", "q2", "q3", "angle.q1", "angle.q2", "angle.q3"]
    return pd.DataFrame(np.hstack([q, read]), columns=names)


def told(folder: Path, table: pd.DataFrame, sensor: Any = None) -> list[Found]:
    path, recording = written(folder, GANTRY | {"sensor": sensor or encoder()}, table)
    loaded = truepose.load_machine(path)
    return list(encoders(loaded, truepose.load_recording(loaded, recording)))


def _scaled(column: str, factor: float) -> Callable[[pd.DataFrame], pd.DataFrame]:
    return lambda table: table.assign(**{column: table[column] * factor})


RAD = np.pi / 180.0
SLIPS = [
    (_scaled("angle.q2", RAD), "unit-angle", "angle.q2", "angle.q2 in rad"),
    (_scaled("angle.q2", 1e3 * RAD), "unit-angle", "angle.q2", "angle.q2 in mrad"),
    (_scaled("angle.q1", 0.1), "unit-length", "angle.q1", "angle.q1 in cm"),
    (_scaled("angle.q1", 1.0 / 25.4), "unit-length", "angle.q1", "angle.q1 in inch"),
    (lambda t: t.rename(columns={"angle.q3": "angle.q3 [rad]"}), "unit-angle", "angle.q3", "angle.q3 in deg"),
    (_scaled("angle.q3", -1.0), "sign", "angle.q3", "angle.q3 counts the other way than q3"),
]


@pytest.mark.parametrize("lost", [0, 9])
@pytest.mark.parametrize(("spoil", "kind", "where", "says"), SLIPS)
def test_a_slip_is_told_in_words_and_mended(
    spoil: Any, kind: str, where: str, says: str, lost: int, tmp_path: Path
) -> None:
    """Alone among the columns, also where half of its readings were lost."""
    table = spoil(rows())
    named = [name for name in table.columns if name.startswith(where)]
    table.loc[: lost - 1, named] = np.nan
    (found,) = told(tmp_path, table)
    assert (found.kind, found.where, found.verdict) == (kind, (where,), "wrong")
    assert found.says == says
    assert found.before is not None and found.after is not None
    assert found.after == pytest.approx(0.0, abs=1e-9) and found.unit == (
        "mm" if where == "angle.q1" else "deg"
    )
    assert found.mend is not None
    pair = found.mend(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"]))
    (tmp_path / "mended.csv").write_text(pair.sheets[0].text(), encoding="utf-8")
    machine = truepose.load_machine(tmp_path / "arm.yaml")
    assert not list(encoders(machine, truepose.load_recording(machine, tmp_path / "mended.csv")))


def test_two_columns_that_were_exchanged_are_exchanged_once(tmp_path: Path) -> None:
    """Encoders of angles; with a length nothing is exchanged."""
    table = rows()
    table[["angle.q2", "angle.q3"]] = table[["angle.q3", "angle.q2"]].to_numpy()
    found = told(tmp_path, table)
    assert [(f.kind, f.where, f.says, f.fix) for f in found] == [
        ("permutation", (f"angle.{a}",), f"angle.{a} and angle.{b} exchanged",
         f"exchange the headers of columns angle.{a} and angle.{b}") for a, b in (("q2", "q3"), ("q3", "q2"))
    ]  # fmt: skip
    pair = Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"])
    for one in found:
        assert one.mend is not None
        pair = one.mend(pair)
    np.testing.assert_allclose(pair.sheets[0].numbers("angle.q2"), rows()["angle.q2"])
    np.testing.assert_allclose(pair.sheets[0].numbers("angle.q1"), rows()["angle.q1"])


def test_a_column_that_follows_nothing_is_told_with_what_it_differs_by(tmp_path: Path) -> None:
    """Nine of twenty rows stand 200 mm away; the sixteen that differ least count, five of them those."""
    table = rows()
    table.loc[:8, "angle.q1"] += 200.0 * np.array([1, -1, 1, -1, 1, -1, 1, -1, 1])
    (found,) = told(tmp_path, table)
    assert (found.kind, found.where, found.verdict) == ("unexplained", ("angle.q1",), "wrong")
    assert found.before == pytest.approx(200.0 * np.sqrt(5 / 16)) and found.unit == "mm"
    assert found.after is None and found.mend is None


@pytest.mark.parametrize(("share", "kinds"), [(0.198, []), (0.202, ["unexplained"])])
@pytest.mark.parametrize("joint", ["q1", "q3"])
def test_a_fifth_of_a_joint_s_way_is_physics(
    share: float, kinds: list[str], joint: str, tmp_path: Path
) -> None:
    table = rows()
    table[f"angle.{joint}"] += share * float(np.std(table[joint])) * np.tile([1.0, -1.0], ROWS // 2)
    assert [f.kind for f in told(tmp_path, table)] == kinds


def test_joints_at_rest_and_whole_turns_are_passed_over(tmp_path: Path) -> None:
    table = _scaled("angle.q3", -1.0)(rows())
    assert told(tmp_path, table.assign(q3=20.0)) == []
    assert told(tmp_path, rows()) == []
    turns = rows()
    turns["angle.q2"] += 360.0 * np.arange(ROWS)  # an encoder that counts turns
    assert told(tmp_path, turns) == []


@pytest.mark.parametrize("joint", ["q1", "q2"])
@pytest.mark.parametrize(
    ("own", "scatter", "limit"),
    [
        (encoder(), 0.0, 0.1),
        (encoder(), 0.1, 0.3),
        (encoder(sigma=0.1), 0.0, 0.5),
        (encoder(0.0, 1e-4), 0.0, 5e-4),
    ],
)
def test_a_zero_is_off_by_five_tolerances_or_sigmas_or_three_times_the_scatter(
    own: Document, scatter: float, limit: float, joint: str, tmp_path: Path
) -> None:
    """Whichever is most; either way round, and turns of an angle do not count."""
    swing = scatter * np.tile([1.0, -1.0], ROWS // 2)
    name = f"angle.{joint}"
    for size, count in ((0.98 * limit, 0), (1.02 * limit, 1), (-0.98 * limit, 0), (-1.02 * limit, 1)):
        table = rows()
        table[name] += swing + size + (360.0 if joint == "q2" else 0.0)
        found = told(tmp_path, table, own)
        assert [(f.kind, f.where, f.verdict) for f in found] == count * [("offset", (name,), "suspect")]
        if found and found[0].mend is not None:
            pair = found[0].mend(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"]))
            assert pair.get(("sensor", "zero", joint)) == pytest.approx(size, rel=1e-3)


@pytest.mark.parametrize(
    ("own", "joint", "at", "verdict", "key"),
    [
        (encoder(0.0), "q2", 2.9, "suspect", "angle"),
        (encoder(0.0), "q2", 3.1, "wrong", "angle"),
        (encoder(0.0), "q2", -3.1, "wrong", "angle"),
        (encoder(0.0), "q1", 90.0, "suspect", "length"),
        (encoder(), "q2", 90.0, "suspect", "angle"),
        (encoder(zero={"q2": 20.0}), "q2", 25.0, "suspect", "angle"),
        (encoder(zero={"q2": 170.0}), "q2", 190.0, "suspect", "angle"),
    ],
)
def test_a_zero_is_certain_where_it_is_said_to_be_exact_and_no_calibration_finds_it(
    own: Document, joint: str, at: float, verdict: str, key: str, tmp_path: Path
) -> None:
    table = rows()
    table[f"angle.{joint}"] += at
    if "zero" in own and joint != "q2":
        table["angle.q2"] += own["zero"]["q2"]
    for sensor, head in (
        (own, ("sensor",)),
        ([{"type": "position", "sigma": {"xyz": 0.03}}, own], ("sensor", 1)),
    ):
        whole = table.assign(x=1.0, y=2.0, z=3.0)
        (found,) = told(tmp_path, whole, sensor)
        assert (found.verdict, found.before, found.after) == (verdict, None, None) and found.mend is not None
        pair = found.mend(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"]))
        assert pair.get((*head, "zero", joint)) == pytest.approx(at)
        assert pair.get((*head, "tolerance", key)) == float("inf")
