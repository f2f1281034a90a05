"""Sums over chunks of rows add up to the whole."""

from __future__ import annotations

import numpy as np
import pytest

from support.simulated import machine_from
from support.tiny_fleets import GAIN, PLAY, machine_text, rows
from truepose import load_recording
from truepose.identification.fit.estimate import estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures import signatures as summing
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.linearisation import Linearisation
from truepose.identification.signatures.signatures import Signatures
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return machine_from(tmp_path_factory.mktemp("tiny"), machine_text(), "machine")


@pytest.fixture(scope="module")
def recording(machine: Machine) -> Recording:
    """Rows with a clock, a temperature, two sessions, some lost readings, and sides that only their order tells."""
    frame = rows(5, [GAIN, PLAY], 80).drop(columns=["approach.q2"])
    frame["time"], frame["temperature.air"] = 30.0 * np.arange(len(frame)), 20.05 + np.arange(len(frame)) % 7
    frame["session"] = np.where(np.arange(len(frame)) < 30, 1, 2)
    frame.loc[[3, 50], "x"] = np.nan
    return load_recording(machine, frame)


def drawn(signatures: Signatures) -> list[Linearisation]:
    """At a fit with an effect, whose errors of form are columns, too: the whole, and each half."""
    fit = estimate(signatures.machine, signatures.recording, [signatures.candidates[0]])
    whole, halves = signatures.halved(fit)
    return [signatures.linearise(fit), whole, *halves]


def test_chunks_add_up_to_the_whole(
    machine: Machine, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    signatures = Signatures(machine, recording, catalogue(machine, recording).candidates)
    whole = drawn(signatures)
    monkeypatch.setattr(summing, "CHUNK", 23)
    for one, sum_ in zip(whole, drawn(signatures), strict=True):
        assert one.counts == sum_.counts
        for gram, other in zip(one.grams, sum_.grams, strict=True):
            size = np.sqrt(np.diag(gram))
            assert np.all(
                np.abs(gram - other) <= 1e-12 * np.outer(size, size)
            )  # rounding of some hundred terms
