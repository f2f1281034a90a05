"""Laws of errors of form: their size beside the signal, and what modulates it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.sensor_bench import Bench
from truepose.identification.prior import FORM_ERROR
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.linearisation import Forms
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Machine, Recording]:
    bench = Bench(tmp_path_factory.mktemp("bench"), "arm")
    return bench.machine, bench.recording()


def test_errors_of_form_are_a_tenth_of_the_signal_that_they_modulate(
    recorded: tuple[Machine, Recording],
) -> None:
    """Their 1-sigma in all the rows together, whatever the columns' number; none where nothing was fitted."""
    _, recording = recorded
    used = ~recording.validation
    rng = np.random.default_rng(7)
    amplitude = np.array([0.4, -1.1])
    forms = Forms.of(recording, used, [(np.array([0, 1]), amplitude), (np.array([3]), np.array([2.0]))])
    assert np.mean(np.sum(forms.modulations[used] ** 2, axis=1)) == pytest.approx(FORM_ERROR**2)
    assert forms.width == 2 * forms.modulations.shape[1]
    rows = np.flatnonzero(used)
    signature = rng.standard_normal((len(rows), 3, 4))
    columns = forms.columns(signature, rows)
    assert columns.shape == (len(rows), 3, forms.width)
    half = forms.width // 2
    expected = (signature[:, :, :2] @ amplitude)[:, :, None] * forms.modulations[rows][:, None, :]
    np.testing.assert_allclose(columns[:, :, :half], expected)
    np.testing.assert_allclose(
        columns[:, :, half:], 2.0 * signature[:, :, 3:] * forms.modulations[rows][:, None, :]
    )
    assert Forms.of(recording, used, []).width == 0
    assert Forms.none().columns(signature, rows).shape == (len(rows), 3, 0)


def test_what_does_not_vary_modulates_nothing(recorded: tuple[Machine, Recording]) -> None:
    """A joint at rest has no range; a driver that is not thermal, a load or the time is no reason for an error of form."""
    _, recording = recorded
    used = ~recording.validation
    signal = [(np.array([0]), np.ones(1))]
    whole = Forms.of(recording, used, signal).width
    q = recording.q.copy()
    q[:, 0] = 0.3
    assert Forms.of(replace(recording, q=q), used, signal).width == whole - 2
    n = len(recording)
    warm = {
        "temperature.air": np.linspace(20.0, 25.0, n),
        "approach.q1": np.where(np.arange(n) % 2 > 0, 1.0, -1.0),
    }
    bare = replace(recording, drivers={}, time=None)
    both = Forms.of(replace(bare, drivers=warm), used, signal).width
    assert both == Forms.of(bare, used, signal).width + 2
