"""The study of the door: its machines are truepose's by another computation, and it sees each way to break the law."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from door.drawing import families, make
from door.judging import fits, may_be_right, worth
from door.kinds import KINDS
from door.outcome import RIGHT, Outcome
from door.pairs import MACHINE, RECORDING, found, write
from door.sitting import Answer, sit
from door.slips import NEEDS, SLIPS
from door.table import table

from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.result import Check, Found
from truepose.identification.load import load_recording
from truepose.identification.prediction.predictor import Predictor
from truepose.models.load import load_machine

SEED = 3
AGREES = 1e-9
"""mm, and as much of a direction cosine times a metre."""
PLAIN = {"sigma": 0.02, "known": True, "poses": 40, "turning": 1.0}


@pytest.mark.parametrize("family", families())
def test_a_drawn_machine_stands_where_truepose_has_it(family: str, tmp_path: Path) -> None:
    """Own kinematics in numpy, and the machine file read: the same poses of the same readings."""
    for j, name in enumerate({n[1]: n for n in families()[family]}.values()):
        pair = make(name, np.random.default_rng([SEED, j]), 0, **PLAIN, tolerance=0.0)
        folder = tmp_path / str(j)
        write(folder, pair.document, pair.table, pair.files)
        machine = load_machine(folder / MACHINE)
        predictor = Predictor(machine, load_recording(machine, pair.table))
        p = predictor.model.p_home
        poses, _ = predictor.poses(p, predictor.assemble(p)[0])
        assert pair.tool is not None
        np.testing.assert_allclose(poses[:, :3, 3], pair.tool[:, :3, 3], atol=AGREES, rtol=0.0)
        np.testing.assert_allclose(poses[:, :3, :3], pair.tool[:, :3, :3], atol=AGREES / 1e3, rtol=0.0)


@pytest.mark.parametrize("family", families())
def test_a_right_pair_is_one_that_the_law_speaks_of(family: str, tmp_path: Path) -> None:
    pair = make(families()[family][0], np.random.default_rng(SEED), 0, **PLAIN, tolerance=0.1)
    write(tmp_path / "pair", pair.document, pair.table, pair.files)
    assert may_be_right(worth(tmp_path / "pair"))


@pytest.mark.parametrize("kind", KINDS)
def test_a_slip_leaves_the_pair_alone(kind: str) -> None:
    for k, name in enumerate([n for own in families().values() for n in own[:1]] * 5):
        rng = np.random.default_rng([SEED, k])
        pair = make(name, rng, 1, **{**PLAIN, "tolerance": 0.1, **NEEDS.get(kind, {})})
        document, before = pair.draft()
        spoilt = SLIPS[kind](pair, rng)
        assert pair.document == document
        pd.testing.assert_frame_equal(pair.table, before)
        if spoilt is not None:
            assert (spoilt.document != document) != (not spoilt.table.equals(before))
            return
    raise AssertionError(f"{kind}: found no pair that can have it")


def test_what_a_free_base_takes_up_is_no_slip(tmp_path: Path) -> None:
    pair = make(
        ("elbow", "serial", "position"),
        np.random.default_rng(SEED),
        0,
        **{**PLAIN, "known": False},
        tolerance=0.1,
    )
    moved = pair.table.assign(x=pair.table["y"], y=-pair.table["x"])
    mirrored = pair.table.assign(x=pair.table["y"], y=pair.table["x"])
    for name, rows in (("right", pair.table), ("moved", moved), ("mirrored", mirrored)):
        write(tmp_path / name, pair.document, rows, pair.files)
    right = worth(tmp_path / "right")
    assert fits(worth(tmp_path / "moved"), right)
    assert not fits(worth(tmp_path / "mirrored"), right)


def saying(mend: Callable[[Path], Callable[[Pair], Pair] | None]) -> Callable[[Path], Answer]:
    """Return an examinee that is certain of a slip which is none of those that are made."""

    def answer(folder: Path) -> Answer:
        found = Found("elsewhere", ("nowhere",), "another slip", "mend it", "wrong", mend=mend(folder))
        return Answer(Check((found,), 40, None))

    return answer


def back_to(name: str) -> Callable[[Path], Callable[[Pair], Pair]]:
    """Return the mend that puts the pair of another folder in the place of the one that is asked for."""
    return lambda folder: (
        lambda _: Pair.read(folder.parent / name / MACHINE, [folder.parent / name / RECORDING])
    )


def silent(_: Path) -> Answer:
    """Say that all is well."""
    return Answer(Check((), 40, None))


def sat(kind: str, examinee: Callable[[Path], Answer], keep: Path) -> Outcome:
    """Return the outcome of the first pair of a kind."""
    return sit(kind, 0, SEED, keep, examinee)


def test_each_way_to_break_the_law_is_seen_and_its_files_are_kept(tmp_path: Path) -> None:
    passed = sat("base-moved", silent, tmp_path)
    blamed = sat(RIGHT, saying(back_to("right")), tmp_path)
    misled = sat("base-moved", saying(back_to("case")), tmp_path)
    assert passed.is_passed and blamed.is_blamed and misled.is_misled
    assert found(tmp_path / passed.name / "case") and found(tmp_path / passed.name / "right")
    text = table([passed, blamed, misled])
    assert "right pairs called wrong: 1 of 1" in text
    assert "called ok: 1 of 2" in text
    assert "advice wrong: 1 of 2" in text


def test_a_mend_is_right_by_what_it_does_whatever_it_is_called(tmp_path: Path) -> None:
    right = sat("base-moved", saying(back_to("right")), tmp_path)
    unmended = sat("base-moved", saying(lambda _: None), tmp_path)
    assert (right.advice, unmended.advice) == ("right", "wrong")
    assert not right.breaks_the_law
    assert not sat(RIGHT, silent, tmp_path).breaks_the_law


def test_a_case_is_the_same_for_its_seed(tmp_path: Path) -> None:
    one, other = (sat("coupled", silent, tmp_path) for _ in range(2))
    assert (one.variant, one.source, one.worst, one.times) == (
        other.variant,
        other.source,
        other.worst,
        other.times,
    )
