"""The tool's pose by results and keys, what a perfect instrument would read, and bounds of an improved model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from challenge import keys
from challenge.examinee import PLAIN, TOOL
from challenge.perfect import seen_perfectly, without_sensor
from challenge.predictions import beyond_bounds
from challenge.setup import Setup
from challenge.simulator.base import Campaign, Imperfection, Kind, Plan, Specimen
from challenge.sizing import Sized
from challenge.solutions import HeldOut, Solution, Truth
from challenge.strata import Draft
from challenge.tool_pose import point_columns, pose_error, read_pose_ratio, true_points
from proof_support.challenge_replies import PLAY, key
from proof_support.tiny_machine import Tiny
from support.tiny_fleets import ANGLE, LENGTH, MACHINE, SIGMA

Array = NDArray[np.float64]
SLIP = Truth("slip", "fringe-miscount", ("rows",), 2.0, 1.0, 0.5, 20.0)

POINTS = np.random.default_rng(3).uniform(-500, 500, (12, 6))
TWO = tuple(f"P{k}.{axis}" for k in (1, 2) for axis in "xyz")


def _table(values: Array) -> pd.DataFrame:
    return pd.DataFrame(values, columns=list(TWO))


class TestToolPose:
    @given(st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-1e3, 1e3)] * 3))
    def test_where_the_instrument_stands_does_not_matter(
        self, turn: tuple[float, ...], shift: tuple[float, ...]
    ) -> None:
        off = 0.1 * np.random.default_rng(4).standard_normal(POINTS.shape)
        moved = Rotation.from_rotvec(turn).apply((POINTS + off).reshape(-1, 3)) + shift
        error = pose_error(_table(POINTS + off), TWO, POINTS)
        assert error is not None and 0 < error < np.sqrt(np.mean(np.sum(off.reshape(-1, 3) ** 2, axis=1)))
        assert pose_error(_table(moved.reshape(-1, 6)), TWO, POINTS) == pytest.approx(error, abs=1e-9)
        assert pose_error(_table(moved.reshape(-1, 6) * [1, 1, np.nan, 1, 1, 1]), TWO, POINTS) is None
        assert pose_error(_table(moved.reshape(-1, 6)[1:]), TWO, POINTS) is None

    @pytest.mark.parametrize(
        ("columns", "wanted"),
        [
            ("x y z", True),
            (" ".join(TWO), True),
            ("x y z rx ry rz", True),
            ("dL", False),
            ("P1.x P2.y P1.z", False),
        ],
    )
    def test_which_sensors_read_points(self, columns: str, wanted: bool) -> None:
        assert bool(point_columns(columns.split())) is wanted

    def _solution(self, *truths: Truth, told: bool = True) -> Solution:
        held = HeldOut(TWO, ("mm",) * 6, (0.01,) * 6, tuple(map(tuple, POINTS.tolist())))
        return replace(key(*truths), held_out=held, tool=held.truth if told else None)

    def test_the_ratio_is_read_from_results(self, tmp_path: Path) -> None:
        off = np.random.default_rng(5).standard_normal(POINTS.shape)
        solution = self._solution(PLAY)
        assert read_pose_ratio(tmp_path, solution) is None
        for improved, plain, ratio in ((0.2, 1.0, 0.2), (1.0, 0.5, 2.0), (1e-3, 1e-5, 1.0)):
            _table(POINTS + improved * off).to_csv(tmp_path / TOOL)
            _table(POINTS + plain * off).to_csv(tmp_path / PLAIN)
            # small turns of random errors are taken up by the refit, a little otherwise at each size
            assert read_pose_ratio(tmp_path, solution) == pytest.approx(ratio, rel=1e-2)

    def test_a_key_without_it_tells_it_where_the_instrument_is_right(self) -> None:
        lens = Truth("lens", "lens-distortion", ("sensor",), 1.0, 1.0, 0.1, 9.0)
        for truths, known in (((PLAY,), True), ((), True), ((PLAY, lens), False), ((SLIP,), False)):
            points = true_points(self._solution(*truths, told=False))
            assert (points is not None and np.array_equal(points, POINTS)) is known
        assert true_points(self._solution(lens)) is not None
        assert true_points(key(PLAY)) is None  # x alone is no point


class Scaled(Tiny):
    """The same with a scale bar of the wrong length."""

    def kinds(self) -> tuple[Kind, ...]:
        return (*super().kinds(), SCALE)

    def measure(
        self, specimen: Specimen, imperfections: tuple[Imperfection, ...], campaign: Campaign
    ) -> Array:
        seen = super().measure(specimen, tuple(i for i in imperfections if i.kind != SCALE.name), campaign)
        return seen * (1 + sum(i.size for i in imperfections if i.kind == SCALE.name))


SCALE = Kind("scale-bar", (("sensor",),), 1e-3, "sensor-scale")


def test_the_key_holds_what_a_perfect_instrument_would_read() -> None:
    rng = np.random.default_rng(3)
    setup = Setup.draw(Scaled(), Scaled().specimen(rng), Plan(poses=8), rng)
    gain, scale = Imperfection("gain", ("q1",), 1e-3), Imperfection("scale-bar", ("sensor",), 1e-3)
    parts = tuple(Sized(thing, 1.0, 9.0, np.zeros(1)) for thing in (gain, scale))
    both = Draft(setup, (Kind("gain", (("q1",),), 1e-4, "actuator-scale"), SCALE), parts)
    seen = setup.exact((gain, scale))[1]
    told = np.array(keys.perfect_readings(both, seen))
    assert np.allclose(told * 1.001, seen) and np.array_equal(told, setup.exact((gain,))[1])
    alone = replace(both, kinds=both.kinds[:1], parts=parts[:1])
    assert np.array_equal(np.array(keys.perfect_readings(alone, told)), told)


TEXT = MACHINE.format(length=LENGTH, angle=float(np.degrees(ANGLE)), sigma=SIGMA)
SCALED = "{effect: sensor-scale, place: [sensor], parameters: {s: {value: 0.01, unit: '1'}}}"
SLACK = "{{effect: backlash, place: [q1], parameters: {{b: {{value: {}, unit: rad}}}}}}"


class TestFiles:
    def test_a_perfect_instrument_sees_the_model_without_its_sensor(self, tmp_path: Path) -> None:
        (tmp_path / "rows.csv").write_text("q1,q2,approach.q1\n10,20,1\n-30,5,-1\n")
        slack = SLACK.format(0.01)
        for name, entries in (("both", f"[{SCALED}, {slack}]"), ("one", f"[{slack}]"), ("bare", "[]")):
            (tmp_path / f"{name}.yaml").write_text(f"{TEXT}effects: {entries}\n")
        both, one, bare = (
            seen_perfectly(tmp_path / f"{n}.yaml", tmp_path / "rows.csv") for n in ("both", "one", "bare")
        )
        pd.testing.assert_frame_equal(both, one)
        assert np.max(np.abs(one["x"] - bare["x"])) > 0.1
        assert without_sensor({"effects": [{"place": ["sensor2"]}], "covariance": {}, "name": "a"}) == {
            "name": "a"
        }

    @pytest.mark.parametrize(
        ("value", "wanted"), [(1e-4, False), (0.0, False), (-1e-16, False), (-1e-5, True)]
    )
    def test_play_is_never_negative(self, tmp_path: Path, value: float, wanted: bool) -> None:
        (tmp_path / "improved.yaml").write_text(f"{TEXT}effects: [{SLACK.format(value)}]\n")
        assert beyond_bounds(tmp_path / "improved.yaml") is wanted
        (tmp_path / "improved.yaml").write_text("nonsense: [")
        assert beyond_bounds(tmp_path / "improved.yaml") is None
