"""Laws of lines: gains of a periodogram are those of least squares, spacing says how far it reaches, and evidence judges."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.sensor_bench import Bench
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.diagnosis.findings import common_ratio
from truepose.identification.diagnosis.null_fits import null_fits
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.predict import simulate
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue, catalogue
from truepose.identification.signatures.lines import Spectrum, proposed, spectrum
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.transmission_error import TransmissionError
from truepose.models.machine.machine import Machine


@settings(max_examples=20, deadline=None)
@given(order=st.integers(31, 900), seed=st.integers(0, 10_000))
def test_gain_is_that_of_least_squares_on_a_sine_and_a_cosine(order: int, seed: int) -> None:
    """Half of what the sum of squares falls by; bins of a turn are fine enough for a percent."""
    rng = np.random.default_rng(seed)
    angle, slope = rng.uniform(-2.6, 2.6, 120), rng.uniform(0.2, 1.5, 120)
    reading = 4.0 * slope * np.sin(order * angle + 0.7) + rng.standard_normal(120)
    found = spectrum(angle, slope * reading, slope**2)
    columns = slope[:, None] * np.column_stack([np.sin(order * angle), np.cos(order * angle)])
    left = reading - columns @ np.linalg.lstsq(columns, reading, rcond=None)[0]
    assert found.gain[order] == pytest.approx(0.5 * (reading @ reading - left @ left), rel=0.05)
    assert int(np.argmax(found.gain[31:])) + 31 == order


@pytest.mark.parametrize("n", [2, 3, 8, 25, 64, 199])
def test_of_so_many_places_of_a_turn_half_as_many_orders_are_told_apart(n: int) -> None:
    angle = 2.0 * np.pi * np.arange(5 * n) / n - 1.0
    found = spectrum(angle, np.zeros(len(angle)), np.ones(len(angle)))
    assert found.finest == n // 2


def test_readings_at_random_reach_every_order_that_is_looked_for() -> None:
    angle = np.random.default_rng(3).uniform(-2.0, 2.0, 80)
    assert spectrum(angle, angle, np.ones(80)).finest == 4096


@pytest.mark.parametrize(
    ("lines", "ratio"),
    [((404.0, 1010.0, 2020.0, 128.0), 202.0), ((101.0, 303.0, 404.0, 256.0), 101.0), ((97.0, 128.0), 0.0)],
)
def test_ratio_that_lines_have_in_common(lines: tuple[float, ...], ratio: float) -> None:
    """The largest of which they are whole multiples, without what counts in powers of two; two lines have none."""
    assert common_ratio(lines) == pytest.approx(ratio, abs=0.5)


def _with_line(recording: Recording, machine: Machine, order: float) -> Recording:
    """The third joint stands 0.25 mrad beside its reading, in waves: readings are what the joint without them would read."""
    at = machine.mechanism.readings.index("q3")
    q = recording.q.copy()
    wanted = q[:, at]
    read = wanted.copy()
    for _ in range(60):  # read + wave(read) = wanted
        read = wanted - 2.5e-4 * np.sin(order * read + 0.4)
    q[:, at] = read
    return replace(recording, q=q)


@pytest.mark.nightly
@pytest.mark.parametrize("order", [100.0, 101.0])
def test_an_order_of_a_hundred_is_named_without_a_gear_ratio(tmp_path: Path, order: float) -> None:
    """The simulation turns the reading, and knows no effect of the catalogue; contraction by 0.025 settles it."""
    bench = Bench(tmp_path, "arm")
    found = diagnose(bench.machine, _with_line(bench.recording(), bench.machine, order))
    (one,) = [f for f in found.findings if f.effect == "transmission-error"]
    assert one.place == ("q3",) and one.probability > 0.9
    assert f"A line at {order:g} cycles a turn of q3" in one.explanation


@pytest.mark.parametrize(
    ("rows", "series"), [(1000, [(61.0, 120.0), (121.0, 180.0)]), (700, [(61.0, 120.0)]), (500, [])]
)
def test_a_series_above_the_catalogue_s_has_five_rows_an_order(
    rows: int, series: list[tuple[float, float]], tmp_path: Path
) -> None:
    """Waves of all orders in a joint: no series is proposed whose orders are more than a fifth of the rows, or beyond 180."""
    machine, rng = Bench(tmp_path, "arm").machine, np.random.default_rng(1)
    ranges = np.degrees([a.range or (0.0, 0.0) for a in machine.mechanism.actuators])
    told = dict(
        zip(machine.mechanism.readings, rng.uniform(ranges[:, 0], ranges[:, 1], (rows, 6)).T, strict=True)
    )
    seen = simulate(machine, load_recording(machine, told, need_observations=False), [], seed=3)
    recording = load_recording(machine, told | {axis: seen[axis].to_numpy() for axis in "xyz"})
    at = machine.mechanism.readings.index("q1")
    q = recording.q.copy()
    orders = np.arange(61, 241)
    waves = np.sin(np.outer(q[:, at], orders) + rng.uniform(0, 2 * np.pi, len(orders)))
    q[:, at] += 2e-5 * waves.sum(axis=1)
    moved = replace(recording, q=q)
    fit = null_fits(machine, moved).before
    before = catalogue(machine, moved)
    found = proposed(Signatures(machine, moved, before.candidates), fit, before).candidates
    first = [c.settings_map for c in found if c.place == ("q1",) and "first" in c.settings_map]
    assert [(s["first"], s["orders"]) for s in first] == series


# -- what is proposed, at which price -----------------------------------------------------------------------------


def test_peaks_are_the_highest_orders_that_stand_apart() -> None:
    """Four at most, none below the least, none that is known or within the width of a higher one."""
    gain = np.zeros(60)
    gain[[40, 42, 45, 50, 10, 20, 55]] = 9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0
    found = Spectrum(gain)
    assert found.finest == 59
    assert found.peaks(2.5, 3.5, set()) == [40, 45, 50, 10]
    assert found.peaks(1.9, 3.5, set()) == [40, 42, 45, 50]
    assert found.peaks(2.0, 3.5, set()) == [40, 45, 50, 10]  # two orders apart are not farther apart than two
    assert found.peaks(2.5, 3.5, {40, 10}) == [42, 45, 50, 20]
    assert found.peaks(2.5, 6.0, set()) == [40, 45, 50]
    assert found.peaks(2.5, 9.5, set()) == []
    assert found.peaks(100.0, 0.0, set()) == [40]


def case(folder: Path, size: float, order: float = 100.0) -> tuple[Signatures, Estimate, Catalogue]:
    """An arm whose third joint errs by a wave of so many mrad, its fit without it, and the candidates."""
    bench = Bench(folder, "arm")
    recording = bench.recording()
    q, at = recording.q.copy(), bench.machine.mechanism.readings.index("q3")
    q[:, at] -= 1e-3 * size * np.sin(order * q[:, at] + 0.4)
    moved = replace(recording, q=q)
    cat = catalogue(bench.machine, moved)
    return Signatures(bench.machine, moved, cat.candidates), estimate(bench.machine, moved), cat


@pytest.fixture(scope="module")
def wavy(tmp_path_factory: pytest.TempPathFactory) -> tuple[Signatures, Estimate, Catalogue]:
    return case(tmp_path_factory.mktemp("wavy"), 0.3)


def spectrum_of(signatures: Signatures, fit: Estimate, joint: str) -> Spectrum:
    mechanism = signatures.machine.mechanism
    score, weight, rows = signatures.scores(fit, [mechanism.actuator(joint).displacement])
    return spectrum(signatures.recording.q[rows, mechanism.readings.index(joint)], score[:, 0], weight[:, 0])


def orders(cat: Catalogue, joint: str) -> dict[float, float]:
    """Log prior of each single order of a joint."""
    return {
        c.settings_map["order"]: log
        for c, log in zip(cat.candidates, cat.log_prior, strict=True)
        if c.at_place == ("transmission-error", (joint,)) and "order" in c.settings_map
    }


def test_finer_orders_weigh_together_what_a_series_does_and_less_the_finer_they_are(
    wavy: tuple[Signatures, Estimate, Catalogue],
) -> None:
    signatures, fit, cat = wavy
    more = proposed(signatures, fit, cat)
    assert more.candidates[: len(cat.candidates)] == cat.candidates
    assert more.log_prior[: len(cat.log_prior)] == cat.log_prior
    own = {order: log for order, log in orders(more, "q3").items() if order > 30.0}
    assert 100.0 in own and len(own) <= 4
    (series,) = (
        log
        for c, log in zip(cat.candidates, cat.log_prior, strict=True)
        if c.at_place == ("transmission-error", ("q3",)) and "orders" in c.settings_map
    )
    finest = spectrum_of(signatures, fit, "q3").finest
    of_order = {order: np.exp(log) * order for order, log in own.items()}
    for whole in of_order.values():  # the sum of 1 / k over finer orders is a log
        assert whole * np.log(finest / 30.0) == pytest.approx(np.exp(series))
    span = np.ptp(signatures.recording.q[:, signatures.machine.mechanism.readings.index("q3")])
    pairs = [abs(a - b) for a in own for b in own if a < b]
    assert min(pairs, default=np.inf) > 2.0 * np.pi / span


def test_a_line_is_proposed_where_it_could_pay_its_price(
    wavy: tuple[Signatures, Estimate, Catalogue],
) -> None:
    """The log prior of the coarsest of them, against what chi2 falls by; what was proposed is no news."""
    signatures, fit, cat = wavy
    more = proposed(signatures, fit, cat)
    below = 0
    for joint in signatures.machine.mechanism.readings:
        found = spectrum_of(signatures, fit, joint)
        coarsest = max(orders(cat, joint).values()) - np.log(np.log(found.finest / 30.0) * 30.0 / 10.0)
        own = {round(order) for order in orders(more, joint) if order > 30.0}
        beyond = set((np.flatnonzero(found.gain[31:] >= -coarsest) + 31).tolist())
        assert own <= beyond and bool(own) is bool(beyond)
        if own:
            assert int(np.argmax(found.gain[31:])) + 31 in own
        below += int(np.sum(found.gain[31:] < -coarsest))
    assert below > 1000
    assert proposed(signatures.of(more.candidates), fit, more) is more


def test_orders_that_a_fit_has_are_not_proposed_anew(wavy: tuple[Signatures, Estimate, Catalogue]) -> None:
    signatures, _, cat = wavy
    machine, effect = signatures.machine, TransmissionError()
    held = PlacedEffect.at(effect, machine, ("q3",), {"order": 100.0})
    fit = estimate(machine, signatures.recording, [held])
    own = orders(proposed(signatures.of([*cat.candidates, held]), fit, cat), "q3")
    assert 100.0 not in own


def test_a_joint_that_stands_still_has_no_lines(wavy: tuple[Signatures, Estimate, Catalogue]) -> None:
    """Nor does any joint have them in fewer rows than two series' orders would need."""
    signatures, fit, cat = wavy
    machine, q = signatures.machine, signatures.recording.q.copy()
    q[:, 0] = 0.3
    still = replace(signatures.recording, q=q)
    with np.errstate(divide="raise", invalid="raise"):
        found = proposed(Signatures(machine, still, cat.candidates), fit, cat)
    assert all(order <= 30.0 for order in orders(found, "q1"))
    few = replace(fit, used=fit.used & (np.cumsum(fit.used) < 10))
    assert proposed(signatures, few, cat) is cat


@pytest.mark.parametrize("waves", [{47}, set(range(1, 41)), set(range(61, 71))])
def test_a_constant_is_no_line_and_the_highest_gain_is_one_of_the_waves(waves: set[int]) -> None:
    rng = np.random.default_rng(4)
    angle = rng.uniform(-3.0, 3.0, 600)
    score = 2.0 + 5.0 * np.sum([np.sin(k * angle + k) for k in waves], axis=0)
    found = spectrum(angle, score, np.ones(600))
    assert found.gain[0] == 0.0 and np.all(found.gain >= 0.0)
    assert int(np.argmax(found.gain)) in waves
