"""Sections on fits, proofs, limits, constants and drivers: what stands in each table, and when it is there at all."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from support.reports import NAN, fitted, of, recorded, rows
from truepose.identification.diagnosis.result import (
    BlockProof,
    Diagnosis,
    Proof,
)
from truepose.identification.report.constants import constants_blocks, departure_block
from truepose.identification.report.drivers import columns
from truepose.identification.report.fit_tables import fit_section, proof_table
from truepose.identification.report.gains import stated_noise
from truepose.identification.report.numbers import significant
from truepose.models.machine.machine import Machine
from truepose.shown.document import Charts, Table, Text

# -- fits and proofs -----------------------------------------------------------------------------------


def test_fits_stand_side_by_side_with_validation_rows_where_there_are_any(plain: Diagnosis) -> None:
    table = of(fit_section(plain).blocks, Table)[0]
    names = [row[0] for row in table.rows]
    assert names == [
        "rms residual, calibration rows [σ]", "rms position, calibration rows", "rms residual, validation rows [σ]",
        "rms position, validation rows", "chi2 / degree of freedom", "farthest parameter [tolerances]",
        "what a true model stays below in 99 of 100 cases",
    ]  # fmt: skip
    told = dict(zip(names, rows(table), strict=True))
    assert told["rms position, calibration rows"][1:] == ["12.0 µm"] * 3
    assert told["rms position, validation rows"][1:] == ["13.0 µm"] * 3
    assert told["chi2 / degree of freedom"][1:] == ["1.02", "9.00", "1.01"]
    assert told["farthest parameter [tolerances]"][1:] == ["q1.d 60.0", "q1.d 12.0", "q1.d 1.20"]
    assert told[names[-1]][1:] == ["-", "3.10", "3.10"]
    used, held = plain.before.used, plain.recording.validation
    for name, mask in ((names[0], used), (names[2], held)):
        size = float(np.sqrt(np.mean(plain.before.residual[mask] ** 2)))
        assert float(told[name][2]) == pytest.approx(size, rel=6e-3)  # three digits
    none = replace(plain, recording=replace(plain.recording, validation=np.zeros(30, dtype=bool)))
    assert "validation" not in " ".join(row[0] for row in of(fit_section(none).blocks, Table)[0].rows)
    bare = of(fit_section(replace(plain, proof=None)).blocks, Text)
    assert [text.text for text in bare] == [
        "No effect was added, so there is nothing to prove on held-out rows."
    ]
    assert list(of(fit_section(replace(plain, terms=())).blocks, Table)[0].head)[1:] == [
        "ordinary fit, parameters free", "under tolerances, no effects",
    ]  # fmt: skip


def test_a_reading_that_refers_to_itself_or_was_lost_is_in_no_rms(machine: Machine, plain: Diagnosis) -> None:
    residual = plain.before.residual.copy()
    residual[0], residual[1] = 0.0, NAN
    own = replace(plain, before=replace(plain.before, residual=residual))
    told = rows(of(fit_section(own).blocks, Table)[0])[0]
    kept = residual[2:][plain.before.used[2:]]
    assert float(told[2]) == pytest.approx(float(np.sqrt(np.mean(kept**2))), rel=6e-3)
    assert stated_noise(machine) == {"position": pytest.approx(0.01 * np.sqrt(3.0))}


@pytest.mark.parametrize("held_out", ["role", "blocks"])
def test_each_proof_is_told_with_what_it_should_be(held_out: str) -> None:
    blocks = (BlockProof("validation rows", 5, 0.4), BlockProof("outermost poses", 12, 1.5))
    proof = Proof(held_out, blocks, 0.4, (0.3, 0.5), -0.5, None, None)
    table = proof_table(proof)
    whole = "validation rows" if held_out == "role" else "blocks"
    part = "besides" if held_out == "role" else "of these"
    told = rows(table)
    assert told[0] == [f"held-out rms, after over before ({whole})", "0.400 (0.300 to 0.500)", "below 1"]
    parts = [row for row in told if "fitted without them" in row[0]]
    assert parts == [[f"{part}, outermost poses (12 rows, fitted without them)", "1.50", "below 1"]]
    assert told[-3:] == [
        ["the same for an equally flexible black box", "-", "above the line before"],
        ["log Bayes factor of a placebo (drivers shuffled)", "-0.500", "near or below 0"],
        ["the effect put into simulated readings", "-", "found again"],
    ]
    for recovered, said in ((True, "found again"), (False, "not found again")):
        assert rows(proof_table(replace(proof, injected_recovered=recovered)))[-1][1] == said


# -- limits --------------------------------------------------------------------------------------------


# -- constants -----------------------------------------------------------------------------------------


def test_constants_have_the_digits_that_are_known(machine: Machine) -> None:
    fit = fitted(machine, recorded(machine))
    (table,) = of(constants_blocks(fit, "x.yaml"), Table)
    frame = fit.to_frame().set_index("parameter")
    assert table.caption.startswith("The constants that x.yaml holds. 1 sigma:")
    for name, _, value, std, *_ in rows(table):
        there, known = (float(frame[key].to_dict()[name]) for key in ("value", "std"))
        if np.isfinite(known):
            assert float(value) == pytest.approx(there, abs=0.01 * known)
            assert len(value.partition(".")[2]) <= 2 - np.floor(np.log10(known)) + 1e-9
            assert std == significant(known, 2)
        else:
            assert std == "∞" and value == ("0" if abs(there) < 1e-9 else f"{there:.6g}")
    averaged = of(constants_blocks(fit, "x.yaml", averaged=True), Table)[0]
    assert "They are averages over all explanations that the readings allow" in averaged.caption


def test_departures_are_those_of_constants_with_a_tolerance(machine: Machine, plain: Diagnosis) -> None:
    fits = {"free": plain.free, "before": plain.before, "after": plain.after}
    charts = departure_block(machine, fits, 3.0)
    assert isinstance(charts, Charts)
    names = [p.name for p in machine.parameters if 0 < p.tolerance < np.inf]
    assert sorted(name for chart in charts.charts for name in chart.y.names) == sorted(names)
    assert (
        "Driven out without effects and home with them" in charts.caption
        and "farthest of" not in charts.caption
    )
    alone = departure_block(machine, {"calibrated": plain.before}, None)
    assert isinstance(alone, Charts) and "Driven out" not in alone.caption
    endless = SimpleNamespace(parameters=[replace(p, tolerance=np.inf) for p in machine.parameters])
    text = departure_block(cast(Machine, endless), fits, 3.0)
    assert isinstance(text, Text) and text.text.startswith("No parameter has a finite tolerance")


# -- drivers -------------------------------------------------------------------------------------------


def test_eleven_drivers_that_vary_and_the_order_of_rows_are_drawn(machine: Machine) -> None:
    recording = recorded(machine)
    many = {f"temperature.t{k}": recording.q[:, 0] + k for k in range(14)} | {
        "temperature.still": np.ones(30)
    }
    own = replace(recording, drivers=many)
    names = [one.name for one in columns(machine, own)]
    assert (
        len(names) == 12
        and names[-1] == "order"
        and names[:2] == ["q1", "q2"]
        and "temperature.still" not in names
    )
    kept = [one.name for one in columns(machine, own, ["temperature.t13"])]
    assert "temperature.t13" in kept and len(kept) == 12
    first = columns(machine, own)[0]
    np.testing.assert_allclose(first.values, np.degrees(recording.q[:, 0]))
    assert first.title == "q1 [°]"
    np.testing.assert_array_equal(columns(machine, own)[-1].values, np.arange(1, 31))
