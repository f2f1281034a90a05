"""How much better a slip must fit to be told, and to be certain; what is told beside it where others fit as well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.checked_arm import EXACT, document, rig_of
from truepose.identification.check.drawing import priced
from truepose.identification.check.judging import LIKELY, QUIET, SURE
from truepose.identification.check.rig import Rig
from truepose.identification.check.search import search

NAMES = ("x", "y", "z", "rx", "ry", "rz")


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """Readings of an arm that is as drawn, with half as much noise again as is stated: a price of one."""
    rig = rig_of(tmp_path_factory.mktemp("arm"), document(sensor=EXACT), rows=30)
    rng, rows = np.random.default_rng(1), rig.recording
    sigma = [0.03] * 3 + [np.radians(0.005)] * 3
    seen = {
        n: rows.observations[n] + 1.5 * s * rng.standard_normal(30) for n, s in zip(NAMES, sigma, strict=True)
    }
    return Rig(rig.machine, replace(rows, observations=seen))


def test_thresholds_leave_room_between_a_word_and_certainty() -> None:
    assert (LIKELY, QUIET, SURE) == (1.7, 2.5, 3.0)


def test_nothing_is_told_of_a_right_pair(noisy: Rig) -> None:
    found = search(noisy)
    assert found.found == () and found.scene is noisy.scene and 0.5 < found.price < 1.5


def turned_a_little(rig: Rig, ratio: float) -> Rig:
    """The sixth joint counted the other way, over a way that is so small that this costs ``ratio`` times the noise."""

    def other_way(size: float) -> Rig:
        """As if the joint had moved by ``size``: rows are told apart by where the flange then stands."""
        q = rig.recording.q.copy()
        q[:, 5] = size * np.cos(np.arange(30.0) * 5.0)
        here = Rig(rig.machine, replace(rig.recording, q=q))
        there = here.predictor.over(here.recording)
        p = here.scene.p
        x, _ = here.assembled(there, p, here.scene)
        names, values, _ = there.values(p, x)
        read = dict(zip(names, values.T, strict=True))
        noise = {n: rig.recording.observations[n] - exact[n] for n in NAMES}
        flipped = q * [1, 1, 1, 1, 1, -1]
        seen = {n: read[n] + noise[n] for n in NAMES}
        return Rig(rig.machine, replace(rig.recording, q=flipped, observations=seen))

    whole = rig.predictor.over(rig.recording)
    names, values, _ = whole.values(rig.scene.p, rig.assembled(whole, rig.scene.p, rig.scene)[0])
    exact = dict(zip(names, values.T, strict=True))
    small = other_way(0.0)
    noise = max(priced(small, small.stand(), 1.0), 1.0)
    some = other_way(0.01)
    # what a slip adds to noise adds up by squares, and grows with its size
    slope = np.sqrt(priced(some, some.stand(), noise) ** 2 - noise**2) / 0.01
    return other_way(noise * np.sqrt(ratio**2 - 1.0) / slope)


@pytest.mark.parametrize(("ratio", "verdict"), [(2.7, "suspect"), (3.4, "wrong")])
def test_a_slip_is_certain_that_makes_a_misfit_three_times_smaller(
    ratio: float, verdict: str, noisy: Rig
) -> None:
    rig = turned_a_little(noisy, ratio)
    found = search(rig)
    assert found.found, found.price
    first = found.found[0]
    assert (first.kind, first.where, first.verdict) == ("sign", ("q6",), verdict)
    assert first.before is not None and first.after is not None and first.unit == "mm"
    assert found.price < 1.5 and found.scene is not rig.scene
