"""Laws of a report's first figures, what was gained as squares say, and of its provenance: digests and days."""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.examples import examples
from support.reports import NAN, arm, summary, synthetic
from truepose.identification.diagnosis.result import Applied, PoseError
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.origin import digest_of, recorded_on
from truepose.identification.report.steps import recording_names
from truepose.models.machine.machine import Machine
from truepose.shown.document import Gain

LAWS = settings(max_examples=examples(120), deadline=None)
SIZES = st.floats(1e-6, 1e3)
FLOOR = 0.01 * np.sqrt(3.0)
"""Root of the mean square of a distance whose three axes have the stated sigma, 0.01 mm."""
TOLD = re.compile(r"^(?:(over|below) )?([\d.]+) %")
UNITS = {"nm": 1e-6, "µm": 1e-3, "mm": 1.0}


def gain(machine: Machine, before: float | None, after: float, noise: float = 1.0) -> Gain:
    fits = [
        None if rms is None else replace(summary(1.0, 1.0), rms={"position": rms}, validation_rms=None)
        for rms in (before, after)
    ]
    assert fits[1] is not None
    (found,) = gains_of(machine, fits[0], fits[1], noise)
    return found


def value(text: str) -> float:
    number, unit = text.split()
    mantissa, _, power = number.partition("×10")
    digits = power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    return float(mantissa) * 10.0 ** int(digits or 0) * UNITS[unit]


@given(before=SIZES, after=SIZES)
@LAWS
def test_what_is_explained_is_said_as_squares_say(machine: Machine, before: float, after: float) -> None:
    """Of the squares above the instrument's own: none, all, or a share that never reads as either."""
    said = gain(machine, before, after).explained
    if before <= FLOOR * (1 - 1e-9):
        assert said == ""
    elif before > FLOOR * (1 + 1e-9):
        share = (before**2 - after**2) / (before**2 - FLOOR**2)
        if after >= before:
            assert said.startswith("none of the error")
        elif after <= FLOOR * (1 - 1e-9):
            assert said.startswith("all")
        elif after > FLOOR * (1 + 1e-9) and after < before * (1 - 1e-9):
            found = TOLD.match(said)
            assert found is not None
            bound, number = found[1], float(found[2])
            assert number not in (0.0, 100.0)
            if bound is None:
                assert number == pytest.approx(100 * share, abs=0.51)
            else:
                assert (100 * share > number) == (bound == "over")


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (1.0, 1.0, "none of the error beyond it is explained"),
        (1.0, 0.0, "all of the error beyond it is explained"),
        (1.0, 0.5, "75 % of the squared error beyond it is explained"),
        (None, 0.5, ""),
        (NAN, 0.5, ""),
        (0.5, NAN, ""),
    ],
)
def test_plain_shares(machine: Machine, before: float | None, after: float, said: str) -> None:
    assert gain(machine, before, after).explained == said


@pytest.mark.parametrize(
    ("share", "said"),
    [(0.004, "0.4 %"), (0.006, "1 %"), (0.5, "50 %"), (0.994, "99 %"), (0.996, "99.6 %"), (0.9999, "over 99.9 %")],
)  # fmt: skip
def test_shares_near_none_and_all_have_a_decimal(machine: Machine, share: float, said: str) -> None:
    after = float(np.sqrt(4.0 - share * (4.0 - FLOOR**2)))
    assert gain(machine, 2.0, after).explained == f"{said} of the squared error beyond it is explained"


@pytest.mark.parametrize(
    ("held", "ratio", "where"),
    [
        (False, 0.414, "on the fitted rows; on rows held out in turn it falls to 41 %"),
        (False, NAN, "on the fitted rows"),
        (True, 0.414, "on rows that were not fitted"),
    ],
)
def test_rows_held_out_in_turn_are_told_where_there_are_no_others(
    machine: Machine, held: bool, ratio: float, where: str
) -> None:
    own = summary(1.0, 1.0) if held else replace(summary(1.0, 1.0), validation_rms=None)
    (found,) = gains_of(machine, own, own, ratio=ratio)
    assert found.where == where


@pytest.mark.parametrize(("noise", "told"), [(0.8, "0.80"), (0.81, ""), (1.24, ""), (1.25, "1.2")])
def test_scatter_beside_the_stated_sigma_is_told_with_the_instrument_s(
    machine: Machine, noise: float, told: str
) -> None:
    more = f" by its stated sigma, {told} times that by its scatter" if told else ""
    assert gain(machine, 1.0, 0.5, noise).floor == f"the instrument alone (dashed): 0.0173 mm{more}"


@given(before=SIZES, after=SIZES)
@LAWS
def test_bars_are_as_long_as_the_figures_beside_them(machine: Machine, before: float, after: float) -> None:
    found = gain(machine, before, after)
    assert max(found.shares) == pytest.approx(1.0)
    largest = max(before, after, FLOOR)
    np.testing.assert_allclose(found.shares, np.array([before, after, FLOOR]) / largest, rtol=1e-9)
    for text, number in ((found.before, before), (found.after, after)):
        small = 0.006 * number + 0.5 * 10.0 ** np.floor(np.log10(number)) * 1e-2
        assert value(text) == pytest.approx(number, abs=small)
    assert found.before.split()[1] == found.after.split()[1]  # both in one unit


def test_held_out_rows_are_told_where_there_are_any(machine: Machine) -> None:
    both = replace(summary(1.0, 1.0), rms={"position": 1.0}, validation_rms={"position": 2.0})
    alone = replace(both, validation_rms=None)
    (held,), (fitted,) = gains_of(machine, both, both), gains_of(machine, both, alone)
    assert (held.where, value(held.after)) == ("on rows that were not fitted", 2.0)
    assert (fitted.where, value(fitted.before)) == ("on the fitted rows", 1.0)
    (hollow,) = gains_of(machine, None, replace(alone, rms={"position": NAN}))
    assert hollow.shares[1] == 0.0 and "nan" not in " ".join(map(str, vars(hollow).values())).lower()


def test_noise_beside_the_stated_is_told(machine: Machine) -> None:
    assert "times that by its scatter" not in gain(machine, 1.0, 0.5).floor
    assert "3.0 times that by its scatter" in gain(machine, 1.0, 0.5, noise=3.0).floor


# -- where it comes from -------------------------------------------------------------------------------


@given(data=st.binary(max_size=300))
@LAWS
def test_a_digest_is_that_of_the_bytes(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "digested"
    path.write_bytes(data)
    assert digest_of(path) == digest_of(str(path)) == hashlib.sha256(data).hexdigest()
    recorded_on(path)  # whatever it holds


def test_what_is_no_file_has_no_digest_and_no_day(tmp_path: Path) -> None:
    for nothing in (tmp_path, tmp_path / "none.csv", "a table in memory"):
        assert digest_of(nothing) == recorded_on(nothing) == ""


ROWS = "q1 [deg],q2 [deg],x,y,z\n1,2,3,4,5\n"


@pytest.mark.parametrize(
    ("text", "day"),
    [
        (f"# measured 2026-03-14 in hall 3\n{ROWS}", "2026-03-14"),
        (f"# measured 2026-03-14T10:20:00Z\n{ROWS}", "2026-03-14"),
        (f"\ufeff# measured 2026-03-14\n{ROWS}", "2026-03-14"),
        (f"\n\n  ! 1999-12-31, then 2026-03-14\n{ROWS}", "1999-12-31"),
        (f"% run20260314\n% 2026-03-14\n{ROWS}", "2026-03-14"),
        ("// 2026-03-14\nTarget X Y Z\nP1 1.0 2.0 3.0\n", "2026-03-14"),
        ("Survey of hall 3\n! 2026-03-14\nP1 1.0 2.0 3.0\n", "2026-03-14"),
        (ROWS, ""),
        (f"{ROWS}# 2026-03-14\n", ""),  # below the data: it may be of anything
        ("day,q1,q2\n2026-03-14,1,2\n", ""),  # a cell, no comment
        (";day;q1;q2\n;2026-03-14;1;2\n", ""),
        (f"measured 2026-03-14\n{ROWS}", ""),
        (f"# part 12026-03-14, 2026-03-141, 2026-13-14, 2026-02-30, 1826-03-14\n{ROWS}", ""),
        (f"# 2026-02-30 2026-03-14\n{ROWS}", "2026-03-14"),
        ("#\n" * 60 + f"# 2026-03-14\n{ROWS}", ""),  # far down
    ],
)
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_a_day_is_that_of_the_comments_above_the_data(tmp_path: Path, text: str, day: str, ends: str) -> None:
    path = tmp_path / "rows.csv"
    path.write_bytes(text.replace("\n", ends).encode())
    assert recorded_on(path) == day


def test_a_day_is_read_in_other_encodings_and_in_no_binary_file(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    for encoding in ("utf-16", "utf-8-sig", "latin-1"):
        path.write_bytes(f"# gemessen in Jülich, 2026-03-14\n{ROWS}".encode(encoding))
        assert recorded_on(path) == "2026-03-14"
    path.write_bytes(b"PAR1\x00\n# 2026-03-14\n")
    assert recorded_on(path) == ""


def test_a_recording_knows_its_files_digests_and_days(machine: Machine, tmp_path: Path) -> None:
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for path, head in zip(paths, ("# 2026-03-14\n", ""), strict=True):
        path.write_text(head + ROWS)
    recording = load_recording(machine, paths)
    assert recording.digests == tuple(hashlib.sha256(p.read_bytes()).hexdigest() for p in paths)
    assert recording.dates == ("2026-03-14", "")


def test_names_stand_as_on_a_command_line(machine: Machine) -> None:
    assert recording_names(["/far/off/a.csv", "my rows.csv"]) == "a.csv my\\ rows.csv"
    assert file_name(machine) == "arm.yaml"
    assert file_name(replace(machine, file=None)) == "MACHINE"


def test_the_tool_stands_first_where_it_was_judged_on_rows_held_out_in_turn(tmp_path: Path) -> None:
    """What improved.yaml is worth on rows that were not fitted goes before figures of fitted rows."""
    machine = arm(tmp_path)
    error = PoseError(0.5, 0.2)
    for held_out, first in (("blocks", "the tool's position, rms"), ("role", "position error, rms")):
        applied = Applied("whole", held_out, error, 0.4, error, 0.4)
        opening = diagnosis_opening(synthetic(machine, applied=applied))
        assert opening.gains[0].kind == first
        assert not [one for one in opening.lists if one.title == "What improved.yaml holds"]
    told = diagnosis_opening(
        synthetic(machine, applied=Applied("whole", "blocks", error, 0.4, error, 0.4))
    ).gains[0]
    assert (told.before, told.after) == ("0.500 mm", "0.200 mm")
    assert "improved.yaml" in told.where and "held out in turn" in told.where


def test_what_was_before_is_told_where_an_effect_was_added(tmp_path: Path) -> None:
    found = synthetic(arm(tmp_path))
    (two,), (alone,) = (
        diagnosis_opening(one).gains for one in (found, replace(found, terms=(), findings=()))
    )
    assert (two.before, two.after) == ("13.0 µm", "13.0 µm")
    assert (alone.before, alone.after) == ("", "13.0 µm")


def test_less_than_all_that_was_found_is_told(tmp_path: Path) -> None:
    worse = Applied("plain", "role", PoseError(0.5, 0.5), 1.0, PoseError(0.5, 0.9), 1.2)
    opening = diagnosis_opening(synthetic(arm(tmp_path), applied=worse))
    (holds,) = [one for one in opening.lists if one.title == "What improved.yaml holds"]
    assert "improved.yaml holds plain calibration" in " ".join(holds.items)
    assert not [step for step in opening.steps if "improved.yaml" in getattr(step, "command", "")]
