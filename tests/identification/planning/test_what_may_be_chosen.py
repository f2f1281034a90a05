"""What a plan chooses from and by: rows and factors, rounding, judgement of the worst pair, and how results are read."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from support.experiments import BENT, COMPLIANT, UNEVEN, YIELDING, arm, telescope
from truepose.errors import InputError
from truepose.identification.leaves.planning.discriminate.experiment import IDENTICAL, SPLIT, Experiment, Pair
from truepose.identification.leaves.planning.discriminate.factors import (
    MOST,
    Factor,
    Offer,
    Target,
    explanation,
    factors,
    settings,
    unplanned,
)
from truepose.identification.leaves.planning.discriminate.race import (
    Contest,
    Race,
    Rows,
    chosen,
    ordered,
    recording_of,
)
from truepose.identification.leaves.planning.information import decimals, rounded
from truepose.identification.leaves.planning.plan import CRITERIA, OPEN, Objective, Pool, exchange
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]


def test_rows_are_every_pose_with_every_setting() -> None:
    q, levels = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[0.0, 20.0], [5.0, 20.0], [5.0, 25.0]])
    rows = Rows.crossed(q, ["payload", "temperature.arm"], levels)
    assert len(rows) == 6
    told = {
        (*a, p, t)
        for a, p, t in zip(
            rows.q.tolist(), rows.drivers["payload"], rows.drivers["temperature.arm"], strict=True
        )
    }
    assert told == {(*a, *b) for a in q.tolist() for b in levels.tolist()}
    both = rows.take([5, 0]).joined(rows.take(rows.drivers["payload"] == 0.0))
    assert both.drivers["payload"].tolist() == [5.0, 0.0, 0.0, 0.0] and both.q[0].tolist() == [3.0, 4.0]


def test_rows_become_a_recording_behind_one_at_the_reference() -> None:
    machine = arm()
    q = np.arange(12.0).reshape(2, 6)[:, : len(machine.mechanism.readings)]
    rows = Rows(
        q, {"payload": np.array([2.0, 3.0]), "session": np.array([1.0, 2.0]), "time": np.array([0.0, 60.0])}
    )
    found = recording_of(machine, rows, np.full(q.shape[1], 9.0))
    assert found.q.tolist() == [[9.0] * q.shape[1], *q.tolist()]
    payload = found.driver("payload")
    assert payload is not None
    assert payload.tolist() == [2.0, 2.0, 3.0]
    assert found.session.tolist() == [1, 1, 2] and found.time is not None
    assert not found.validation.any()


@pytest.mark.parametrize(
    ("values", "step", "places"),
    [
        ([0.0], 1e-6, 0),
        ([100.0], 1e-6, 4),
        ([-100.0, 3.0], 1e-6, 4),
        ([90.0], 1e-6, 5),
        ([1.0], 1e-3, 3),
        ([1e6], 1e-6, 0),
    ],
)
def test_as_many_decimals_as_resolve_a_step(values: list[float], step: float, places: int) -> None:
    assert decimals(np.array(values), step) == places


def test_planned_joints_are_short_numbers_inside_their_ranges() -> None:
    machine = arm()
    low, high = np.array([a.range for a in machine.mechanism.actuators], dtype=float).T
    q = np.random.default_rng(1).uniform(low, high, (30, len(low)))
    q[0], q[1] = low, high
    found = rounded(q, machine, 1e-3)
    assert (found >= low).all() and (found <= high).all()
    assert np.max(np.abs(found - q) / (high - low)) <= 0.5e-3 + 1e-12
    assert np.max(np.abs(found - q) / (high - low)) > 1e-5
    unit = [machine.units.of_joint(a.reading_unit) for a in machine.mechanism.actuators]
    for k, u in enumerate(unit):
        if u == "deg":  # ranges of some hundred degrees, a thousandth of which is a tenth
            np.testing.assert_allclose(
                np.degrees(found[2:, k]) * 10, np.round(np.degrees(found[2:, k]) * 10), atol=1e-6
            )


def drivers_of(machine: Machine, *texts: str, offer: Offer | None = None) -> dict[str, Factor]:
    parts = [part for text in texts for form in explanation(text, machine).forms for part in form]
    return {f.driver: f for f in factors(machine, parts, offer or Offer({}))}


def test_loads_that_leg_compliance_reads() -> None:
    bare = drivers_of(telescope(), COMPLIANT, BENT)["payload"]
    assert (bare.levels, bare.nominal, bare.offered) == ((0.0, 5.0), 0.0, False)
    offered = drivers_of(telescope(), COMPLIANT, offer=Offer.of(telescope(), "2,8,4,4"))["payload"]
    assert (offered.levels, offered.nominal, offered.offered) == ((2.0, 4.0, 8.0), 2.0, True)
    held = drivers_of(telescope(), COMPLIANT, offer=Offer.of(telescope(), "6"))["payload"]
    assert (held.levels, held.nominal, held.offered) == ((6.0,), 6.0, False)
    heavy = replace(
        telescope(),
        masses=tuple(replace(m, kg=3.0) if m.name == "payload" else m for m in telescope().masses),
    )
    assert drivers_of(heavy, COMPLIANT)["payload"].levels == (0.0, 3.0)


def levels(count: int) -> tuple[float, ...]:
    return tuple(float(k) for k in range(count))


def test_settings_are_all_or_some_with_their_extremes() -> None:
    rng = np.random.default_rng(0)
    few = [Factor("a", levels(4), 1.0, True), Factor("b", levels(6), 2.0, True)]
    assert len(settings(few, rng)) == 24 == MOST
    many = [*few, Factor("c", levels(3), 1.0, True)]
    found = settings(many, rng)
    assert found.shape == (MOST, 3) and len(np.unique(found, axis=0)) == MOST
    assert [1.0, 2.0, 1.0] in found.tolist()  # as the machine usually stands
    corners = [[a, b, c] for a in (0.0, 3.0) for b in (0.0, 5.0) for c in (0.0, 2.0)]
    assert all(corner in found.tolist() for corner in corners)
    assert settings([], rng).shape == (1, 0)


def test_what_rows_do_not_vary_is_noted() -> None:
    parts = [part for text in (YIELDING, UNEVEN) for part in explanation(text, arm()).forms[0]]
    assert unplanned(parts) == []


@pytest.mark.parametrize(
    ("payload", "says"),
    [
        ("-1,2", "found -1 kg"),
        ("a", "found 'a'"),
        ("1,,2", "found '1,,2'"),
        ("1,inf", "found '1,inf'"),
        ("nan", "found 'nan'"),
    ],
)
def test_payloads_that_are_none_are_refused(payload: str, says: str) -> None:
    with pytest.raises(InputError, match=f"--payload: {says}"):
        Offer.of(arm(), payload)


def test_a_target_is_told_in_the_length_of_the_file() -> None:
    machine = telescope()
    assert Target.of(" T9 = 1, -2,3.5", machine) == Target("T9", (1.0, -2.0, 3.5))
    for text in ("T9", "T9=1,2", "T9=1,2,x", "=1,2,3", "T9=1,2,3,4"):
        with pytest.raises(InputError, match="--target"):
            Target.of(text, machine)


def pair(name: str, rival: str, *, share: float = 0.5, separable: bool = True, twins: bool = False) -> Pair:
    one, other = (explanation(text, arm()) for text in (name, rival))
    return Pair(one, other, 4.0, share, separable, twins)


def experiment(expected: float, *pairs: Pair) -> Experiment:
    nothing: Any = None
    return Experiment(nothing, (), nothing, None, pairs, expected, None, np.zeros(0), (), (), 0)


def test_an_experiment_splits_when_every_pair_is_told_apart() -> None:
    a, b = YIELDING, UNEVEN
    apart = (pair(a, b), pair(b, a))
    assert experiment(SPLIT, *apart).splits and not experiment(SPLIT - 0.01, *apart).splits
    half = (pair(a, b), pair(b, a, separable=False))
    assert not experiment(9.0, *half).splits and len(experiment(9.0, *half).stuck) == 1
    assert not experiment(9.0, *half).hopeless
    none = (pair(a, b, separable=False), pair(b, a, separable=False))
    assert experiment(9.0, *none).hopeless and len(experiment(9.0, *none).stuck) == 1  # each pair once
    assert pair(a, b, twins=True).identical and pair(a, b, share=0.5 * IDENTICAL).identical
    assert not pair(a, b, share=2.0 * IDENTICAL).identical


def test_pairs_are_numbered_rival_by_rival() -> None:
    assert ordered(3) == [(1, 0), (2, 0), (0, 1), (2, 1), (0, 2), (1, 2)]


def contest(seed: int, pairs: tuple[int, ...], rows: int = 9) -> Contest:
    rng = np.random.default_rng(seed)
    k = 3
    earlier = rng.standard_normal((4, k + len(pairs)))
    return Contest(
        rng.standard_normal((rows, 2, k)), rng.standard_normal((rows, 2, len(pairs))), np.ones(k),
        earlier.T @ earlier, np.array(pairs),
    )  # fmt: skip


def test_a_pair_is_worth_half_of_what_the_best_form_of_its_rival_misses() -> None:
    forms = (contest(1, (0, 0, 1)), contest(2, (0, 0, 1)))  # two forms of one rival; pair 0 has two cases
    race, design = Race(forms, 3, np.array([True, True, False])), [0, 4, 5]
    missed = [form.missed(design) for form in forms]
    expected = [min(0.5 * (m[0] + m[1]) for m in missed), min(0.5 * m[2] for m in missed), np.inf]
    np.testing.assert_allclose(race.values(design), expected)
    assert race.worst(design) == pytest.approx(min(expected))
    assert replace(race, counted=np.zeros(3, dtype=bool)).worst(design) == 0.0
    assert replace(race, counted=np.array([False, True, False])).worst(design) == pytest.approx(expected[1])


def test_the_judgement_is_near_the_worst_pair_and_grows_with_each() -> None:
    race = Race((contest(1, (0, 1, 2)),), 3, np.array([True, True, True]))
    values = np.array([2.0, 5.0, 9.0])
    assert 2.0 <= race.judged(values) <= 2.0 * 3.0**0.25 + 1e-12  # at most as if all others were endless
    for k in range(3):
        assert race.judged(values + np.eye(3)[k]) > race.judged(values)
    assert race.judged(np.full(3, 4.0)) == pytest.approx(4.0)
    np.testing.assert_allclose(
        race.judged(np.array([values, 10.0 * values])), race.judged(values) * np.array([1.0, 10.0])
    )
    assert race.judged(np.zeros(3)) > 0.0


def test_rows_are_chosen_once_and_as_many_as_there_are() -> None:
    race = Race((contest(3, (0,)), contest(4, (1,))), 2, np.array([True, True]))
    for n in (1, 4, 9, 20):
        design = chosen(race, n)
        assert len(design) == len(set(design)) == min(n, 9)
    greedy, better = chosen(race, 4, exchange=False), chosen(race, 4)
    assert race.judged(race.values(better)) >= race.judged(race.values(greedy))
    first = [race.judged(race.values([k])) for k in range(9)]
    assert greedy[0] == int(np.argmax(first))
    rest = {k: race.judged(race.values([greedy[0], k])) for k in range(9) if k != greedy[0]}
    assert greedy[1] == max(rest, key=lambda k: rest[k])


@pytest.mark.parametrize("differs", [False, True])
def test_candidates_hold_the_same_information_in_fewer_rows(differs: bool) -> None:
    rng = np.random.default_rng(2)
    signature = rng.standard_normal((6, 4, 2)) @ rng.standard_normal((2, 5))  # four readings of rank two
    pool = Pool.of(signature, np.array([differs] * 4))
    assert pool.signature.shape[1] == (4 if differs else 2)
    if not differs:
        found = np.einsum("cmi,cmj->cij", pool.signature, pool.signature)
        np.testing.assert_allclose(found, np.einsum("cmi,cmj->cij", signature, signature), atol=1e-12)
        np.testing.assert_allclose(pool.rows([3, 0])[1], pool.signature[0])
        return
    rows = pool.rows([3, 0, 5])
    assert not rows[0].any()  # nothing to differ from
    np.testing.assert_allclose(rows[1:], signature[[0, 5]] - signature[[3, 0]])


@pytest.mark.parametrize("name", CRITERIA)
def test_more_information_is_worth_no_less_by_a_criterion_of_all_of_it(name: str) -> None:
    rng = np.random.default_rng(3)
    objective = Objective(
        CRITERIA[name], np.eye(4), np.diag([1.0, 2.0, 0.5, 1.0]) if name in "da" else np.zeros((4, 4))
    )
    rows = rng.standard_normal((5, 2, 4))
    value = objective.value(rows)
    (rank,) = objective.ranks(objective.information(rows)[None])
    assert rank == pytest.approx(value)
    white = objective.whitening(rows)
    np.testing.assert_allclose(white.T @ objective.information(rows) @ white, np.eye(4), atol=1e-9)
    if name not in ("o2", "o4"):  # which look at the ratio of two
        assert objective.value(np.concatenate([rows, rng.standard_normal((1, 2, 4))])) > value
    if name not in "da":
        flat = rows.copy()
        flat[:, :, 3] = 0.0
        assert objective.value(flat) == -np.inf
        assert objective.ranks(objective.information(flat)[None])[0] == -np.inf
        flat[0, 0, 3] = 1e-2 * np.sqrt(OPEN)
        assert objective.value(flat) == -np.inf


def test_a_pose_is_repeated_where_no_other_says_as_much() -> None:
    """Also in a design of as many poses as there are to choose from."""
    pool = Pool(np.array([[[0.01, 0.0]], [[1.0, 0.0]]]), np.zeros(1, dtype=bool))
    objective = Objective(CRITERIA["d"], np.eye(2), np.eye(2))
    assert exchange(pool, objective, [0, 1]) == [1, 1]
