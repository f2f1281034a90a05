"""Settings between the points of the catalogue's grid: the search finds them, asks for nothing where there is nothing
to gain, and names beat curves without a name; bounds and sessions of the terms that a search accepts."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from truepose.identification.diagnosis.effect_evidence import grid_for
from truepose.identification.diagnosis.effect_selection import (
    BOUND_DOUBT,
    LARGEST_COST,
    WIDE,
    Selection,
    log_plausibility,
    log_posterior,
    select,
)

from truepose.identification.diagnosis.candidates import Catalogue, catalogue
from truepose.identification.diagnosis.engine import diagnose
from truepose.identification.diagnosis.refine import log_share, refined
from truepose.identification.diagnosis.signatures import Signatures
from truepose.identification.fit.estimate import Estimate, estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import Coefficient, PlacedEffect, effects
from truepose.models.load import load_machine
from truepose.models.machine import Machine

Array = NDArray[np.float64]

TEXT = """
schema: truepose/machine/1
name: boom
tolerances: {length: 0.1, angle: 0.05}
mechanism:
  type: serial
  joints:
    - {name: s, kind: prismatic, range: [-100, 100]}
    - {name: q, kind: revolute, alpha: -90, d: 60, r: 800, range: [-170, 170]}
frames: {tool: {in: flange, xyz: [200, 0, 30], tolerance: {xyz: 0.5, rpy: 0}}}
sensor: {type: position, sigma: {xyz: 0.002}}
drivers: [time, temperature.link2]
"""
ROWS, SECONDS, ALPHA = 60, 60.0, 2.2e-5


def body(drive: Array, lag: float) -> Array:
    """A lump behind its thermometer by small Euler steps, (n,): not the formula that the engine has."""
    state, out, steps = float(drive[0]), [float(drive[0])], 400
    for before, now in pairwise(drive):
        for k in range(steps):
            state += (before + (now - before) * (k + 0.5) / steps - state) * SECONDS / steps / lag
        out.append(state)
    return np.array(out)


def warm_boom(folder: Path, lag: float, alpha: float = ALPHA) -> tuple[Machine, Recording]:
    """A boom of 800 mm whose length follows its thermometer ``lag`` s behind, and what its tool was seen to do."""
    path = folder / "boom.yaml"
    path.write_text(TEXT)
    machine = load_machine(path)
    rng = np.random.default_rng(7)
    time = SECONDS * np.arange(ROWS)
    warm = 20.0 + 6.0 * (1 - np.exp(-time / 2500)) + 1.5 * np.sin(2 * np.pi * time / 1500)
    s, q = rng.uniform(-100, 100, ROWS), rng.uniform(-170, 170, ROWS)
    frame = pd.DataFrame({"s [mm]": s, "q [deg]": q, "time": time, "temperature.link2": warm})
    unread = load_recording(machine, [written(folder, frame)], need_observations=False)
    predictor = Predictor(machine, unread)
    seen = []
    for k, grown in enumerate(800.0 * alpha * (body(warm, lag) - 20.0)):
        p = predictor.model.p_home.copy()
        p[predictor.model.names.index("q.r")] += grown
        titles, values, _, _ = predictor.columns(p, predictor.assemble(p)[0])
        seen.append(values[k])
    noisy = np.array(seen) + rng.normal(0, 0.002, (ROWS, 3))
    both = pd.concat([frame, pd.DataFrame(noisy, columns=list(titles))], axis=1)
    return machine, load_recording(machine, [written(folder, both)])


def written(folder: Path, frame: pd.DataFrame) -> Path:
    path = folder / f"rows-{len(list(folder.iterdir()))}.csv"
    frame.to_csv(path, index=False)
    return path


class Searched:
    """A recording with all that a search for one lag needs."""

    def __init__(self, folder: Path, lag: float, alpha: float = ALPHA) -> None:
        self.machine, self.recording = warm_boom(folder, lag, alpha)
        self.catalogue = catalogue(self.machine, self.recording)
        self.signatures = Signatures(self.machine, self.recording, self.catalogue.candidates)

    def index(self, lag: float) -> int:
        """The candidate of the boom with this lag."""
        labels = [c.label for c in self.catalogue.candidates]
        return labels.index(f"thermal-expansion@link2,lag={lag:g}")

    def refined(self, index: int) -> tuple[Estimate, Catalogue]:
        """The fit with one candidate, and the catalogue refined there."""
        term = replace(self.catalogue.candidates[index], spread=WIDE)
        fit = estimate(self.machine, self.recording, [term])
        grid = grid_for(self.signatures.linearise(fit), 10.0)
        return fit, refined(self.signatures, self.catalogue, fit, grid, {index: WIDE})


# -- the search ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lag", "point"), [(600.0, 900.0), (420.0, 300.0), (1250.0, 900.0)])
def test_a_lag_between_two_points_is_found_from_either(tmp_path: Path, lag: float, point: float) -> None:
    """Within five of its standard deviations by the curvature of chi2, and with three digits, as it is written."""
    searched = Searched(tmp_path, lag, 8e-5)
    index = searched.index(point)
    fit, better = searched.refined(index)
    found = better.candidates[index].settings_map["lag"]
    at = [replace(_with_lag(searched, found + d), spread=WIDE) for d in (-60.0, 0.0, 60.0)]
    low, middle, high = (estimate(searched.machine, searched.recording, [term]).chi2 for term in at)
    sigma = 60.0 / np.sqrt(max((low + high) / 2 - middle, 1e-12))
    assert abs(found - lag) < 5 * sigma < 200
    assert found == float(f"{found:.3g}")
    assert middle < fit.chi2 - 2


def _with_lag(searched: Searched, lag: float) -> PlacedEffect:
    here = searched.catalogue.candidates[searched.index(900.0)]
    return PlacedEffect.at(here.effect, searched.machine, here.place, {"lag": lag})


def test_only_the_refined_candidate_changes(tmp_path: Path) -> None:
    searched = Searched(tmp_path, 600.0)
    index, old = searched.index(900.0), searched.catalogue
    _, new = searched.refined(index)
    assert new is not old
    same = [k for k in range(len(old.candidates)) if k != index]
    assert all(new.candidates[k] is old.candidates[k] for k in same)
    assert all(new.log_prior[k] == old.log_prior[k] for k in same)
    assert new.log_prior[index] <= old.log_prior[index]


def test_a_lag_on_the_grid_stays_there(tmp_path: Path) -> None:
    searched = Searched(tmp_path, 900.0)
    _, better = searched.refined(searched.index(900.0))
    assert better is searched.catalogue


def test_what_data_say_little_of_is_not_refined(tmp_path: Path) -> None:
    """A boom that hardly grows has no lag to be found."""
    searched = Searched(tmp_path, 600.0, 2e-7)
    _, better = searched.refined(searched.index(900.0))
    assert better is searched.catalogue


def test_an_effect_without_continuous_settings_costs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    searched = Searched(tmp_path, 600.0)
    index = next(
        k for k, c in enumerate(searched.catalogue.candidates) if not c.effect.continuous and c.settings
    )

    def never(*_: object) -> None:
        raise AssertionError("signatures of trials were built")

    monkeypatch.setattr(Signatures, "of", never)
    fit = estimate(searched.machine, searched.recording)
    grid = grid_for(searched.signatures.linearise(fit), 10.0)
    same = refined(searched.signatures, searched.catalogue, fit, grid, {index: WIDE})
    assert same is searched.catalogue


@given(st.floats(0.5, 500.0), st.floats(-50, 50), st.floats(0.1, 30))
def test_the_share_of_a_cell_is_that_of_a_gaussian(sigma: float, middle: float, step: float) -> None:
    values = middle + step * np.array([-1.0, 0.0, 1.0])
    gain = -0.5 * ((values - middle) / sigma) ** 2
    cell = 1000.0
    expected = min(0.0, np.log(np.sqrt(2 * np.pi) * sigma / cell))
    assert log_share(values, gain, cell) == pytest.approx(expected, abs=1e-3)


def test_a_flat_cell_costs_nothing() -> None:
    assert log_share([1.0, 2.0, 3.0], [5.0, 5.0, 5.0], 1.0) == 0.0


# -- what a diagnosis makes of it ----------------------------------------------------------------------------


def test_a_large_effect_between_two_lags_has_its_name_and_is_written(tmp_path: Path) -> None:
    searched = Searched(tmp_path, 604.0, 8e-5)
    diagnosis = diagnose(searched.machine, searched.recording)
    assert diagnosis.verdict == "missing-physics"
    (finding,) = diagnosis.findings
    assert (finding.effect, finding.place) == ("thermal-expansion", ("link2",))
    lag = finding.settings[0]["lag"]
    assert lag == pytest.approx(604.0, abs=40)
    write_calibrated(tmp_path / "improved.yaml", diagnosis.after, diagnosis.recording)
    (written_effect,) = load_machine(tmp_path / "improved.yaml").effects
    assert written_effect.settings_map["lag"] == lag


def test_a_selection_weighs_more_with_the_true_term_than_without(tmp_path: Path) -> None:
    searched = Searched(tmp_path, 900.0)
    without = estimate(searched.machine, searched.recording)
    exclude = np.zeros(ROWS, dtype=np.bool_)
    found = select(searched.signatures, searched.catalogue, without, exclude, 10.0)
    lin = searched.signatures.linearise(without)
    empty = Selection({}, without, lin, found.grid, searched.signatures, searched.catalogue)
    assert found.all_named
    assert log_posterior(found) > log_posterior(empty) + 100


# -- bounds --------------------------------------------------------------------------------------------------


@given(st.floats(1.0, 40.0), st.floats(1.0, 1.5))
def test_the_further_beyond_its_bound_the_more_a_coefficient_costs(times: float, more: float) -> None:
    cat = _bounded()
    here, beyond = (log_plausibility(cat, 0, np.array([v]), np.array([0.0])) for v in (times, times * more))
    assert 0.0 >= here >= beyond >= -LARGEST_COST
    assert here == pytest.approx(max(-0.5 * (np.log(times) / BOUND_DOUBT) ** 2, -LARGEST_COST))
    assert log_plausibility(cat, 0, np.array([-times]), np.array([0.0])) == here


@given(st.floats(-1.0, 1.0), st.floats(0.0, 3.0))
def test_within_its_bounds_a_coefficient_costs_nothing(value: float, std: float) -> None:
    assert log_plausibility(_bounded(), 0, np.array([value]), np.array([std])) == 0.0


def _bounded() -> Catalogue:
    """One candidate whose one coefficient has bounds of one scale either way: a joint's scale."""
    scale = effects.get("actuator-scale", "test")()
    placed = PlacedEffect(scale, ("q",), coefficients=(Coefficient("s", "1", 0.1, -0.1, 0.1),))
    return Catalogue((placed,), (0.0,), ())


def test_more_refraction_than_there_is_raises_a_question() -> None:
    air = effects.get("air-refraction", "test")()
    assert "thermometer" in air.found({"share": 4.5}, {"share": 0.1})
    assert "thermometer" not in air.found({"share": 1.6}, {"share": 0.1})


# -- creep from session to session ---------------------------------------------------------------------------


def recorded(folder: Path, time: Array, session: Array) -> Recording:
    path = folder / "boom.yaml"
    path.write_text(TEXT)
    way = 40 * np.sin(np.arange(len(time)))
    frame = pd.DataFrame({"s [mm]": way, "q [deg]": 0.0, "time": time, "session": session})
    return load_recording(load_machine(path), [written(folder, frame)], need_observations=False)


def test_creep_goes_on_while_one_clock_runs(tmp_path: Path) -> None:
    """A session's end changes nothing for a piezo: it creeps on overnight."""
    time = np.concatenate([60.0 * np.arange(10), 60_000 + 60.0 * np.arange(10)])
    two = recorded(tmp_path, time, np.repeat([1, 2], 10)).driver("creep.s~0.1~2")
    one = recorded(tmp_path, time, np.ones(20, dtype=int)).driver("creep.s~0.1~2")
    assert two is not None
    np.testing.assert_array_equal(two, one)


def test_creep_begins_anew_where_clocks_do(tmp_path: Path) -> None:
    """Times of two sessions that overlap are of two clocks: the second does not know what the first moved."""
    time = np.tile(60.0 * np.arange(10), 2) + np.repeat([0.0, 1.0], 10)
    both = recorded(tmp_path, time, np.repeat([1, 2], 10)).driver("creep.s~0.1~2")
    alone = recorded(tmp_path, time[:10], np.ones(10, dtype=int)).driver("creep.s~0.1~2")
    assert both is not None and alone is not None
    # logarithms of ten ages and of twenty: a processor's vectors may end elsewhere
    np.testing.assert_allclose(both[:10], alone, rtol=1e-13, atol=1e-13)
