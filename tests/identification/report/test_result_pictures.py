"""Small pictures of results: which numbers they draw, in which order, and how many."""

from __future__ import annotations

import re
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from truepose.identification.compensation.compensate import Compensation
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.identifiability.analysis import Identifiability
from truepose.identification.leaves.drift.analysis import Drift
from truepose.identification.leaves.drift.showing import draw_movements
from truepose.identification.leaves.planning.plan import Plan
from truepose.identification.leaves.planning.showing import draw_poses
from truepose.identification.report import pictures
from truepose.shown.drawing import bars, dots, strips

NAN = float("nan")


def named(svg: str) -> list[tuple[str, str]]:
    """Names of bars with their numbers, from the top."""
    _, *told = [one.text or "" for one in ET.fromstring(svg).iter() if one.tag.endswith("text")]
    return list(zip(told[::2], told[1::2], strict=True))


def fit(away: Sequence[float], **more: Any) -> Estimate:
    names = tuple(f"c{k}" for k in range(len(away)))
    own = {"in_tolerances": np.array(away), "prior": SimpleNamespace(names=names), **more}
    return cast(Estimate, SimpleNamespace(**own))


def test_the_twelve_farthest_constants_are_drawn() -> None:
    """The farthest first, either way; those that stand at the drawing not at all; rounding orders nothing."""
    assert named(pictures.tolerances(fit([1.0, -3.0, 0.0, 2.0]))) == [("c1", "-3"), ("c3", "2"), ("c0", "1")]
    many = named(pictures.tolerances(fit([0.5 + k for k in range(14)])))
    assert [name for name, _ in many] == [f"c{k}" for k in range(13, 1, -1)]
    alike = named(pictures.tolerances(fit([2.0, -2.0000001, 2.0000002])))
    assert [name for name, _ in alike] == ["c0", "c1", "c2"]
    marked = pictures.tolerances(fit([1.0, -3.0]))
    assert marked == bars({"c1": -3.0, "c0": 1.0}, title="farthest from the drawing, in tolerances", limit=1)


def test_a_row_s_residual_is_the_root_of_its_mean_square() -> None:
    one = fit([], residual=np.array([[3.0, 4.0], [0.0, 1.0]]))
    drawn = dots({"x": [np.sqrt(12.5), np.sqrt(0.5)]}, title="residual of each row, in stated sigmas")
    assert pictures.residuals({"x": one}) == drawn


@pytest.mark.parametrize("terms", [(), ("one",)])
def test_before_and_after_are_drawn_where_something_was_found(terms: tuple[str, ...]) -> None:
    before, after = (fit([], residual=np.full((2, 1), size)) for size in (3.0, 1.0))
    found = cast(Diagnosis, SimpleNamespace(before=before, after=after, terms=terms))
    fits = {"before": before, "after": after} if terms else {"before": before}
    assert pictures.before_and_after(found) == pictures.residuals(fits)


def movement(name: str, change: Sequence[float], std: Sequence[float]) -> SimpleNamespace:
    return SimpleNamespace(name=name, change=tuple(change), std=tuple(std))


def test_what_moved_is_drawn_by_its_last_change_in_its_own_sigmas() -> None:
    moves = [
        movement("a", (9.0, 2.0), (1.0, 2.0)), movement("b", (-0.3,), (0.1,)), movement("unseen", (), ()),
        movement("held", (1.0,), (0.0,)),
    ]  # fmt: skip
    found = cast(Drift, SimpleNamespace(movements=moves))
    assert named(draw_movements(found)) == [("b", "-3"), ("a", "1")]
    many = [movement(f"m{k}", (float(k + 1),), (1.0,)) for k in range(13)]
    drawn = named(draw_movements(cast(Drift, SimpleNamespace(movements=many))))
    assert [name for name, _ in drawn] == [f"m{k}" for k in range(12, 0, -1)]
    assert draw_movements(cast(Drift, SimpleNamespace(movements=moves[2:]))) == ""


def test_constants_are_drawn_by_what_is_left_of_their_tolerance() -> None:
    def told(*sizes: tuple[str, float, float]) -> Identifiability:
        parts = [SimpleNamespace(name=name, std=std, tolerance=tol) for name, std, tol in sizes]
        return cast(Identifiability, SimpleNamespace(parameters=parts))

    some = told(("a", 0.1, 1.0), ("b", 1.0, 2.0), ("held", 0.0, 0.0), ("free", 1.0, float("inf")))
    assert named(pictures.sights(some)) == [("b", "0.5"), ("a", "0.1")]
    title = "1-sigma to expect, in tolerances: 1 says that the readings tell nothing"
    assert pictures.sights(some) == bars({"b": 0.5, "a": 0.1}, title=title, limit=1.0)
    many = told(*((f"c{k}", 0.01 * (k + 1), 1.0) for k in range(13)))
    assert len(named(pictures.sights(many))) == 12
    assert pictures.sights(told(("held", 0.0, 0.0))) == ""


def test_poses_are_drawn_between_the_ends_of_their_joints_in_the_units_of_the_file() -> None:
    """A joint without a range between the least and the largest that was planned."""
    q = np.array([[0.5, 1.0], [-0.5, 4.0], [0.0, 2.0]])
    turn = SimpleNamespace(reading="q1", reading_unit="rad", range=(-np.pi, np.pi))
    slide = SimpleNamespace(reading="q2", reading_unit="mm", range=None)
    unit = {"q1": "deg", "q2": "mm"}.__getitem__
    machine = SimpleNamespace(mechanism=SimpleNamespace(actuators=[turn, slide]), column_unit=unit)
    found = cast(Plan, SimpleNamespace(machine=machine, q=q))
    drawn = draw_poses(found)
    told = re.findall(r">([^<>]+ \.\. [^<>]+)<", drawn)
    assert told == ["-180 .. 180", "1 .. 4"]
    values = {"q1": np.degrees(q[:, 0]).tolist(), "q2": q[:, 1].tolist()}
    ends = {"q1": (-180.0, 180.0), "q2": (1.0, 4.0)}
    assert drawn == strips(values, ends, title="poses in the joints' ranges")


def test_errors_along_a_path_are_those_of_the_position() -> None:
    before = np.array([[3.0, 4.0, 0.0, 9.0, 9.0, 9.0], [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]])
    found = cast(Compensation, SimpleNamespace(before=before, after=0.1 * before))
    drawn = dots({"before": [5.0, 2.0], "after": [0.5, 0.2]}, title="position error along the path, mm")
    assert pictures.path_errors(found) == drawn
