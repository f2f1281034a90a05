"""How much misfit tolerances explain and what a departure from them costs; which misfit is too much, and how that is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from support.checked_arm import Document, document, rig_of
from truepose.identification.check.drawing import expected, priced
from truepose.identification.check.judging import PHYSICS, hopeless, off, unexplained
from truepose.identification.check.rig import ABSURD, Rig, motion
from truepose.identification.fit.absurd import GROSS
from truepose.identification.prediction.predictor import Predictor

Array = NDArray[np.float64]
FINE = {"type": "pose", "sigma": {"xyz": 1e-4, "rot": 1e-4}}


def drawn(length: float = 0.2, angle: float = 0.05, sensor: dict[str, Any] = FINE) -> Document:
    return document(sensor=sensor, tolerances={"length": length, "angle": angle})


def excess(rig: Rig) -> float:
    """Squared misfit that tolerances add to the noise."""
    return expected(rig, rig.stand()) ** 2 - 1.0


def test_what_tolerances_leave_adds_up_by_squares(tmp_path: Path) -> None:
    lengths, angles, both = (rig_of(tmp_path, drawn(*t)) for t in ((0.2, 0.0), (0.0, 0.05), (0.2, 0.05)))
    assert excess(both) == pytest.approx(excess(lengths) + excess(angles), rel=1e-6)
    assert excess(rig_of(tmp_path, drawn(0.6, 0.0))) == pytest.approx(9.0 * excess(lengths), rel=1e-6)
    assert min(excess(lengths), excess(angles)) > 100.0
    assert expected(rig_of(tmp_path, drawn(0.0, 0.0)), both.stand()) == 1.0


def test_what_tolerances_leave_is_what_the_frames_cannot_take(tmp_path: Path) -> None:
    """Rms of what each constant moves the readings by, off the space of what the two frames move them by."""
    rig = rig_of(tmp_path, drawn())
    stand = rig.stand()
    here = Predictor(rig.machine, rig.recording)
    x, good = here.assemble(stand.p)
    jacobian = np.concatenate([block.jacobian for block in here.blocks(stand.p, x)])
    assert good.all() and len(jacobian) == len(rig.recording)
    flat = jacobian.reshape(-1, len(stand.p))
    frames = np.concatenate([rig.at["base"], rig.at["tool"]])
    others = np.setdiff1d(np.flatnonzero(rig.tolerance > 0), frames)
    moved = flat[:, others] * rig.tolerance[others]
    left = moved - flat[:, frames] @ np.linalg.lstsq(flat[:, frames], moved, rcond=None)[0]
    assert expected(rig, stand) == pytest.approx(np.sqrt(1.0 + np.sum(left**2) / len(flat)), rel=1e-6)


@pytest.mark.parametrize("frame", ["base", "tool"])
def test_a_frame_that_is_held_costs_its_tolerances_and_a_free_one_nothing(frame: str, tmp_path: Path) -> None:
    """Three tolerances off, and readings so fine that nothing else pays: three noises over those of eight rows of ten."""
    real = drawn()
    real["frames"][frame]["xyz"][0] += 3.0 * {"base": 5.0, "tool": 2.0}[frame]
    rig = rig_of(tmp_path, drawn(), real, rows=10)
    stand = rig.stand()
    assert priced(rig, stand, 1.0) < 0.01
    for noise in (1.0, 5.0):
        whole = priced(rig, stand, noise, ())
        assert whole == pytest.approx(noise * 3.0 / np.sqrt(0.8 * 60), rel=0.02)
        assert priced(rig, stand, noise, (frame,)) < 0.01 * noise
        other = "tool" if frame == "base" else "base"
        assert priced(rig, stand, noise, (other,)) == pytest.approx(whole, rel=1e-3)
    assert priced(rig, replace(stand, misfit=float("inf")), 1.0) == float("inf")


def test_gross_rows_are_in_no_price(tmp_path: Path) -> None:
    rig = rig_of(tmp_path, drawn(), rows=20)
    z = rig.scene.rows.observations["z"].copy()
    z[[3, 11, 17]] += 500.0
    assert priced(rig, rig.stand(rig.scene.with_columns({"z": z})), 1.0) < 0.01
    z[[1, 5]] += 500.0
    assert priced(rig, rig.stand(rig.scene.with_columns({"z": z})), 1.0) > 100.0  # a quarter of the rows


@pytest.mark.parametrize(("known", "least"), [(True, "expected"), (False, "motion")])
def test_a_misfit_is_more_than_the_drawing_lets_one_expect(known: bool, least: str, tmp_path: Path) -> None:
    """Twice what tolerances leave; where none is stated a fiftieth of what the tool moves."""
    rig = rig_of(tmp_path, drawn() if known else drawn(0.0, 0.0))
    stand = rig.stand()
    limit = 2.0 * expected(rig, stand) if least == "expected" else ABSURD * motion(rig, stand)
    assert ABSURD == 0.02
    assert not off(rig, replace(stand, misfit=0.99 * limit)) and off(rig, replace(stand, misfit=1.01 * limit))
    assert off(rig, replace(stand, misfit=float("inf")))


def test_nothing_is_hopeless_that_is_cheap_or_small_beside_the_motion(tmp_path: Path) -> None:
    rig = rig_of(tmp_path, drawn())
    stand = rig.stand()
    limit = ABSURD * motion(rig, stand)
    for misfit, price, hope in ((1.01, 1.01, False), (0.99, 1.01, True), (1.01, 0.99, True)):
        assert hopeless(rig, replace(stand, misfit=misfit * limit), price * GROSS) == (not hope)
    assert hopeless(rig, replace(stand, misfit=float("inf")), 0.0)


def test_what_nothing_explains_is_told_by_its_size(tmp_path: Path) -> None:
    rig = rig_of(tmp_path, drawn())
    stand = rig.stand()
    limit = PHYSICS * motion(rig, stand)
    assert PHYSICS == 0.2
    for misfit, verdict in ((0.99 * limit, "suspect"), (1.01 * limit, "wrong")):
        found = unexplained(rig, replace(stand, misfit=misfit, length=12.3456))
        assert (found.kind, found.where, found.verdict) == ("unexplained", (), verdict)
        assert (found.before, found.after, found.unit, found.mend) == (12.3456, None, "mm", None)
        assert found.says == (
            "with base and tool fitted, the drawn machine misses the readings by 12.3 mm,"
            " and no slip that was tried explains it"
        )
        assert (
            found.fix == "compare the table of constants, the order of joints and the rows with their source"
        )
    turned = unexplained(rig, replace(stand, misfit=12.3456, length=None))
    assert "by 12.3 sigma, and" in turned.says and (turned.before, turned.unit) == (12.3456, "sigma")
    nowhere = unexplained(rig, replace(stand, misfit=float("inf"), length=None))
    assert nowhere.says.startswith("the drawn machine cannot stand as its joints were read, and no slip")
    assert (nowhere.verdict, nowhere.before) == ("wrong", None)
    still = Rig(rig.machine, replace(rig.recording, q=rig.recording.q * [1, 1, 0, 1, 0, 1]))
    told = unexplained(still, replace(stand, misfit=12.3456, length=0.5))
    assert (told.kind, told.where, told.fix, told.verdict) == (
        "joint-never-moves", ("q3", "q5"), "record q3 and q5", "suspect",
    )  # fmt: skip
    assert told.says == (
        "q3 and q5 never move in the recording, and with base and tool fitted, the drawn machine misses the readings"
        " by 0.5 mm: they may have moved without being logged"
    )
    one = Rig(rig.machine, replace(rig.recording, q=rig.recording.q * [1, 1, 0, 1, 1, 1]))
    alone = unexplained(one, replace(stand, misfit=12.3456, length=0.5)).says
    assert alone.startswith("q3 never moves in the recording, and ") and ": it may have moved" in alone
