"""Settings between the points of the catalogue's grid: values on both sides of the best one become candidates, and the true
one is named; what else comes with such effects."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support.simulated import machine_from, poses_of
from truepose.arrays import Array
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue, catalogue
from truepose.identification.signatures.lines import PARTS, refined
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effects.base import effects
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

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
    machine = machine_from(folder, TEXT)
    rng = np.random.default_rng(7)
    time = SECONDS * np.arange(ROWS)
    warm = 20.0 + 6.0 * (1 - np.exp(-time / 2500)) + 1.5 * np.sin(2 * np.pi * time / 1500)
    s, q = rng.uniform(-100, 100, ROWS), rng.uniform(-170, 170, ROWS)
    frame = pd.DataFrame({"s [mm]": s, "q [deg]": q, "time": time, "temperature.link2": warm})
    predictor = Predictor(machine, poses_of(machine, frame))
    seen = []
    for k, grown in enumerate(800.0 * alpha * (body(warm, lag) - 20.0)):
        p = predictor.model.p_home.copy()
        p[predictor.model.names.index("q.r")] += grown
        titles, values, _, _ = predictor.columns(p, predictor.assemble(p)[0])
        seen.append(values[k])
    noisy = np.array(seen) + rng.normal(0, 0.002, (ROWS, 3))
    both = pd.concat([frame, pd.DataFrame(noisy, columns=list(titles))], axis=1)
    return machine, load_recording(machine, both)


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

    def lags(self, cat: Catalogue, start: int = 0) -> list[float]:
        """Of the candidates from a number on."""
        return [float(c.settings_map["lag"]) for c in cat.candidates[start:]]


# -- the search ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def searched(tmp_path_factory: pytest.TempPathFactory) -> Searched:
    return Searched(tmp_path_factory.mktemp("boom"), 600.0)


def test_values_between_a_setting_and_its_neighbours_become_candidates(searched: Searched) -> None:
    """A quarter, half and three quarters of the way to both; at an end of the grid to one side only."""
    old = searched.catalogue
    index = searched.index(900.0)
    here = old.candidates[index]
    grid = sorted(
        float(c.settings_map["lag"])
        for c in old.candidates
        if (c.effect.slug, c.place) == (here.effect.slug, here.place)
    )
    for own in grid:
        new = refined(searched.machine, old, [searched.index(own)])
        near = [
            v
            for v in (grid[max(grid.index(own) - 1, 0)], grid[min(grid.index(own) + 1, len(grid) - 1)])
            if v != own
        ]
        expected = [
            float(f"{own + share * (v - own):.3g}") for v in near for share in np.arange(1, PARTS) / PARTS
        ]
        assert searched.lags(new, len(old.candidates)) == pytest.approx(expected)
        assert {c.place for c in new.candidates[len(old.candidates) :]} == {("link2",)}
        again = refined(searched.machine, new, [searched.index(own)])
        gaps = [abs(v - own) for v in searched.lags(again, len(new.candidates))]
        assert max(gaps) < min(abs(v - own) for v in near)  # ever closer to the best one


def test_new_values_share_the_prior_of_the_old_one_and_nothing_else_changes(searched: Searched) -> None:
    old, index = searched.catalogue, searched.index(900.0)
    new = refined(searched.machine, old, [index])
    count = len(old.candidates)
    assert all(new.candidates[k] is old.candidates[k] for k in range(count))
    same = [k for k in range(count) if k != index]
    assert all(new.log_prior[k] == old.log_prior[k] for k in same)
    shared = [new.log_prior[index], *new.log_prior[count:]]
    assert len(set(shared)) == 1 and np.logaddexp.reduce(shared) == pytest.approx(old.log_prior[index])


def test_there_is_an_end_to_it(searched: Searched) -> None:
    """Neighbours within two percent of a value are as good as it."""
    cat, index = searched.catalogue, searched.index(900.0)
    for _ in range(12):
        finer = refined(searched.machine, cat, [index])
        if finer is cat:
            break
        cat = finer
    assert finer is cat
    assert len({c.label for c in cat.candidates}) == len(cat.candidates)


def test_an_effect_without_continuous_settings_costs_nothing(searched: Searched) -> None:
    cat = searched.catalogue
    fixed = [k for k, c in enumerate(cat.candidates) if not c.effect.continuous]
    assert refined(searched.machine, cat, fixed) is cat
    stated = replace(cat, stated=(searched.index(900.0),))
    assert refined(searched.machine, stated, [searched.index(900.0)]) is stated  # what the file says stays


# -- what a diagnosis makes of it ----------------------------------------------------------------------------


def test_a_large_effect_between_two_lags_has_its_name_and_is_written(tmp_path: Path) -> None:
    searched = Searched(tmp_path, 604.0, 8e-5)
    diagnosis = diagnose(searched.machine, searched.recording)
    assert diagnosis.verdict == "missing-physics"
    (finding,) = diagnosis.findings
    assert (finding.effect, finding.place) == ("thermal-expansion", ("link2",))
    lag = finding.settings[0]["lag"]
    assert lag == pytest.approx(604.0, abs=60)
    write_calibrated(tmp_path / "improved.yaml", diagnosis.after, diagnosis.recording)
    written = load_machine(tmp_path / "improved.yaml").effects
    assert {(e.effect.slug, e.place) for e in written} == {("thermal-expansion", ("link2",))}
    # lags that are as likely share the coefficient between them
    largest = max(written, key=lambda e: abs(e.values["alpha"]))
    assert largest.settings_map["lag"] == lag
    assert sum(e.values["alpha"] for e in written) == pytest.approx(
        finding.parameters["alpha"].value, rel=0.02
    )


# -- creep from session to session ---------------------------------------------------------------------------


def recorded(folder: Path, time: Array, session: Array) -> Recording:
    way = 40 * np.sin(np.arange(len(time)))
    frame = pd.DataFrame({"s [mm]": way, "q [deg]": 0.0, "time": time, "session": session})
    return poses_of(machine_from(folder, TEXT), frame)


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


def test_more_refraction_than_there_is_raises_a_question() -> None:
    air = effects.get("air-refraction", "test")()
    assert "thermometer" in air.found({"share": 4.5}, {"share": 0.1})
    assert "thermometer" not in air.found({"share": 1.6}, {"share": 0.1})
