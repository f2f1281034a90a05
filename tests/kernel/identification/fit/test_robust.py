"""Estimates under trouble: outliers, rows left out, too few rows, searches that find no minimum."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from support.built_machines import (
    ARM,
    POSE,
    UNKNOWN,
    Machines,
    departures,
    manufactured,
    nominal,
    read_machines,
    simulated,
)
from support.moving_machines import written
from truepose.errors import ConvergenceError, InputError
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.leastsquares import minimise
from truepose.models.machine.machine import Machine


def test_huber_resists_outliers_that_draw_least_squares_away(machines: Machines) -> None:
    machine, rng = machines["hexapod"], np.random.default_rng(8)
    truth = manufactured(machine, rng)
    clean = simulated(machine, truth, rng, 60)
    wild = {name: values.copy() for name, values in clean.observations.items()}
    wild["x"][::12] += 2.0
    wild["rz"][3::20] += 0.01
    recording = replace(clean, observations=wild)
    plain, robust = (estimate(machine, recording, loss=loss) for loss in ("gauss", "huber"))
    at = plain.prior.free
    drawn = np.abs(plain.p - truth)[at] / np.sqrt(np.diag(plain.posterior))
    assert drawn.max() > 10.0  # as little as it would know of itself by the stated sigmas
    assert np.abs(departures(plain, truth)).max() < 5.0  # it sees the noise that it has
    assert np.abs(departures(robust, truth)).max() < 5.0
    sure = plain.std[at] < 0.5 * plain.prior.sigma[at]
    assert np.median((robust.std[at] / plain.std[at])[sure]) < 0.2
    assert np.all(robust.weights[::12] < 0.1)
    assert np.median(robust.weights) == 1.0


def test_validation_rows_and_excluded_rows_are_not_fitted(machines: Machines) -> None:
    machine, rng = machines["arm"], np.random.default_rng(10)
    recording = simulated(machine, manufactured(machine, rng), rng)
    out = np.arange(len(recording)) % 4 == 0
    spoiled = {name: np.where(out, values + 1.0, values) for name, values in recording.observations.items()}
    fits = [
        estimate(machine, recording.subset(~out)),
        estimate(machine, replace(recording, observations=spoiled), exclude=out),
        estimate(machine, replace(recording, observations=spoiled, validation=out)),
    ]
    for fit in fits[1:]:
        assert np.abs(departures(fit, fits[0].p)).max() < 1e-3
        assert fit.chi2 == pytest.approx(fits[0].chi2, rel=1e-6)
        np.testing.assert_array_equal(fit.used, ~out)


def test_rows_that_cannot_be_assembled_are_left_out_and_listed(machines: Machines) -> None:
    machine, rng = machines["hexapod"], np.random.default_rng(11)
    recording = simulated(machine, manufactured(machine, rng), rng)
    q = recording.q.copy()
    q[5, 2] = 5000.0
    fit = estimate(machine, replace(recording, q=q))
    rest = estimate(machine, recording.subset(np.arange(len(q)) != 5))
    assert fit.unassembled == (5,)
    assert np.abs(departures(fit, rest.p)).max() < 1e-3


def test_too_few_rows_are_refused(tmp_path: Path) -> None:
    machine = written(tmp_path, "tolerances: {length: .inf, angle: .inf}\n" + UNKNOWN + ARM + POSE)
    recording = simulated(machine, nominal(machine), np.random.default_rng(12), 6)
    with pytest.raises(
        InputError, match=r"simulated\.csv: found 6 usable rows \(36 readings\).* 42 parameters"
    ):
        estimate(machine, recording)


def test_a_fit_that_does_not_converge_names_what_still_moves(
    machines: Machines, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, rng = machines["arm"], np.random.default_rng(13)
    truth = nominal(machine)
    truth[[p.name for p in machine.parameters].index("tool.x")] += 20.0
    recording = simulated(machine, truth, rng)
    monkeypatch.setattr(
        "truepose.identification.fit.estimate.minimise", lambda *a, **k: minimise(*a, **(k | {"limit": 1}))
    )
    with pytest.raises(ConvergenceError, match=r"iteration limit.*responsible: .*tool\.x"):
        estimate(machine, recording)


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.mktemp("machines"))


def test_huber_and_least_squares_agree_without_outliers(machines: Mapping[str, Machine]) -> None:
    machine, rng = machines["arm"], np.random.default_rng(9)
    recording = simulated(machine, manufactured(machine, rng), rng)
    plain, robust = (estimate(machine, recording, loss=loss) for loss in ("gauss", "huber"))
    assert np.abs(departures(robust, plain.p)).max() < 1.5
