"""What is said of directions that no reading sees: which frame moves, along which axes, and what undoes it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from truepose.identification.fit.estimated import Estimate
from truepose.identification.report.gauge import grouped, rank_words, still, weak_words
from truepose.models.machine.machine import FRAMES
from truepose.models.machine.mechanism import AXES

Array = NDArray[np.float64]
FRAMED = [f"{frame}.{axis}" for frame in FRAMES for axis in AXES]
NAMES = ["q1.r", "q1.theta", "q2.r", "q2.theta", *FRAMED, "sensor.a"]


def blind(*directions: dict[str, float], seed: int | None = None) -> Estimate:
    """A fit that does not see these; ``seed``: the same directions spanned by others."""
    rows = np.array([[one.get(name, 0.0) for name in NAMES] for one in directions]).reshape(-1, len(NAMES))
    basis = np.linalg.qr(rows.T)[0].T if len(rows) else rows
    if seed is not None:
        basis = np.linalg.qr(np.random.default_rng(seed).normal(size=(len(rows), len(rows))))[0] @ basis
    prior = SimpleNamespace(names=["held", *NAMES], free=np.arange(1, len(NAMES) + 1))
    told = SimpleNamespace(prior=prior, null_space=basis, rank=len(NAMES) - len(rows))
    return cast(Estimate, told)


BASE = {"base.z": 1.0, "q1.r": -1.0}
TURN = {"base.rz": 1.0, "q1.theta": -1.0, "q2.theta": 0.5}
TOOL = {"tool.x": 1.0, "q2.r": 0.3}
INSIDE = {"q2.theta": 1.0, "sensor.a": 2.0}
BOTH = {"base.x": 1.0, "tool.y": 1.0}


def against(frame: str, ways: str, axes: str, undone: str) -> str:
    return (
        f"The {frame} frame can move against the mechanism in {ways} (of {axes}) without changing a reading"
        f"{undone}. Neither is a measurement of its own."
    )


@pytest.mark.parametrize(
    ("directions", "said"),
    [
        ([BASE], [against("base", "1 way", "z", "; what undoes it is q1.r")]),
        (
            [BASE, TURN],
            [against("base", "2 ways", "z rz", "; what undoes it is q1.r, q*.theta (2)")],
        ),
        (
            [BASE, TOOL],
            [
                against("base", "1 way", "z", "; what undoes it is q1.r"),
                against("tool", "1 way", "x", "; what undoes it is q2.r"),
            ],
        ),
        ([{"base.z": 1.0}], [against("base", "1 way", "z", "")]),
        (
            [INSIDE],
            ["In 1 way parameters of the mechanism or the sensor move together, or alone, unseen: q2.theta, sensor.a."],
        ),
        ([BOTH], ["In 1 more way the base frame and the tool frame move against each other."]),
        (
            [BOTH, {"base.z": 1.0, "tool.z": -2.0}],
            ["In 2 more ways the base frame and the tool frame move against each other."],
        ),
        (
            [TOOL, INSIDE, BOTH],
            [
                against("tool", "1 way", "x", "; what undoes it is q2.r"),
                "In 1 more way the base frame and the tool frame move against each other.",
                "In 1 way parameters of the mechanism or the sensor move together, or alone, unseen: q2.theta, sensor.a.",
            ],
        ),
    ],
)  # fmt: skip
def test_each_way_to_move_unseen_is_told_once(directions: list[dict[str, float]], said: list[str]) -> None:
    """Whatever vectors span them."""
    count = len(NAMES)
    first = (
        f"The readings alone determine {count - len(directions)} of {count} directions that the free parameters"
        f" could move in; along the other {len(directions)} no reading changes, and only tolerances hold them."
    )
    for seed in (None, 3, 4):
        assert rank_words(blind(*directions, seed=seed)) == [first, *said]


def test_what_moves_by_less_than_a_hundredth_of_the_others_takes_no_part() -> None:
    for small, shown in ((0.009, "q1.r"), (0.011, "q1.r, q2.theta")):
        (_, text) = rank_words(blind({"base.z": 1.0, "q1.r": -1.0, "q2.theta": small}))
        assert f"; what undoes it is {shown}. " in text
    # beside a frame that moves far itself its own motion does not count
    (_, text) = rank_words(blind({"base.z": 1e3, "q1.r": -1.0}))
    assert "; what undoes it is q1.r. " in text


def test_fourteen_that_take_part_are_named() -> None:
    names = [f"{chr(97 + k)}.r" for k in range(16)]
    for count, more in ((14, ""), (15, " and 1 more"), (16, " and 2 more")):
        row = np.ones((1, count)) / np.sqrt(count)
        prior = SimpleNamespace(names=names[:count], free=np.arange(count))
        fit = cast(Estimate, SimpleNamespace(prior=prior, null_space=row, rank=count - 1))
        assert rank_words(fit)[1].endswith(f"unseen: {', '.join(names[: min(count, 14)])}{more}.")


def test_where_nothing_is_blind_that_is_said() -> None:
    assert rank_words(blind()) == [
        f"The readings alone determine all {len(NAMES)} free parameters; how well, the next line says."
    ]


def test_directions_along_which_some_stand_still_are_those_of_the_span() -> None:
    """Dimension by counting: each condition takes one away; the result lies in the span and is orthonormal."""
    rng = np.random.default_rng(6)
    basis = np.linalg.qr(rng.normal(size=(9, 4)))[0].T
    for count in range(6):
        fixed = np.arange(9) < count
        found = still(basis, fixed)
        assert found.shape == (max(4 - count, 0), 9)
        np.testing.assert_allclose(found[:, fixed], 0.0, atol=1e-12)
        np.testing.assert_allclose(found @ found.T, np.eye(len(found)), atol=1e-12)
        np.testing.assert_allclose(found @ basis.T @ basis, found, atol=1e-12)
    assert still(basis, np.zeros(9, dtype=bool)) is basis
    assert still(np.zeros((0, 9)), np.ones(9, dtype=bool)).shape == (0, 9)


def test_names_that_differ_by_numbers_are_one() -> None:
    assert grouped(["leg1.a.x", "q1.r", "leg2.a.x", "leg12.a.x"]) == ["leg*.a.x (3)", "q1.r"]


@pytest.mark.parametrize(
    ("std", "said"),
    [
        ((0.89, 0.5, 9.0, 9.0), None),
        ((0.91, 0.5, 9.0, 9.0), "For 1 of 2 parameters with a tolerance"),
        ((0.91, 1.81, 9.0, 9.0), "For 2 of 2 parameters with a tolerance"),
        ((0.5, 1.81, 9.0, 9.0), "For 1 of 2 parameters with a tolerance"),
    ],
)  # fmt: skip
def test_constants_known_no_better_than_to_nine_tenths_of_their_tolerance(
    std: tuple[float, ...], said: str | None
) -> None:
    """Neither what has no tolerance, nor the coefficient of an effect, is one of them."""
    prior = SimpleNamespace(
        names=("a", "b", "endless", "effect.c"), free=np.arange(4), sigma=np.array([1.0, 2.0, np.inf, 1.0])
    )
    machine = SimpleNamespace(parameters=("a", "b", "endless"))
    fit = cast(Estimate, SimpleNamespace(prior=prior, std=np.array(std), nominal=machine))
    (text,) = weak_words(fit)
    if said is None:
        assert text == "Every parameter is known better than its drawing said."
    else:
        names = [name for name, s, limit in zip("ab", std, (0.9, 1.8), strict=False) if s > limit]
        assert text.startswith(f"{said} the readings say next to nothing beyond the drawing")
        assert text.endswith(f": {', '.join(names)}.")
