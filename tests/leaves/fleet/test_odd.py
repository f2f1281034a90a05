"""Laws of oddness: a machine is judged by the others alone, in whatever order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import expit, logit
from scipy.stats import t as student

from support.fleets import DrawnFleet, mixed_machines
from truepose.identification.leaves.fleet.odd import ODD, OTHERS, SURE, Oddness, oddness
from truepose.identification.leaves.fleet.pooled import Pooled
from truepose.identification.prior import URN

Kept = Mapping[str, Any]


def judged(every: Sequence[Kept]) -> list[Oddness]:
    return oddness(Pooled.of(every))


@given(seed=st.integers(0, 2**20), order=st.permutations(range(12)))
def test_a_machine_is_judged_alike_in_any_order(seed: int, order: list[int]) -> None:
    every = mixed_machines(np.random.default_rng(seed), 12)
    together = judged(every)
    assert judged([every[k] for k in order]) == [together[k] for k in order]


@given(seed=st.integers(0, 2**20), number=st.integers(1, 30))
def test_shares_are_what_the_others_say(seed: int, number: int) -> None:
    """Worked out anew from the definition, one machine and one thing after the other, without any sums."""
    every = mixed_machines(np.random.default_rng(seed), number)
    for kept, told in zip(every, judged(every), strict=True):
        others = [one for one in every if one is not kept and one["mechanism"] == kept["mechanism"]]
        shares = by_effect(kept, others) | by_size(kept, others) | by_constant(kept, others)
        expected = {thing: share for thing, share in shares.items() if share < 0.99 * ODD}
        found = {(reason.kind, reason.name): reason.share for reason in told.reasons}
        assert found.keys() >= expected.keys() and all(shares[thing] < 1.01 * ODD for thing in found)
        for thing, share in found.items():
            assert share == pytest.approx(shares[thing], rel=2e-3, abs=1e-9)
        least = min([1.0, *(len(shares) * share for share in found.values())])
        assert told.score == pytest.approx(-np.log10(max(least, 1e-300)), abs=1e-9)
        assert told.odd == (least < ODD)
        assert [reason.share for reason in told.reasons] == sorted(found.values())


Shares = dict[tuple[str, str], float]


def of(kept: Kept, effect: str, place: str) -> list[Any] | None:
    """What a machine says of an effect at a place that was possible."""
    one: list[Any] | None = kept["places"].get(effect, {}).get(place)
    return one if one is not None and one[1] > 0.0 else None


def by_effect(kept: Kept, others: Sequence[Kept]) -> Shares:
    out = Shares()
    for effect, places in kept["places"].items():
        for place in places:
            own = of(kept, effect, place)
            theirs = [one for one in (of(other, effect, place) for other in others) if one is not None]
            if own is None or not theirs:
                continue
            usual = float(expit(np.mean([logit(one[1]) for one in theirs])))
            share = (sum(one[0] for one in theirs) + URN * usual) / (len(theirs) + URN)
            if own[0] >= SURE:
                out["present", f"{effect}@{place}"] = share
            elif own[0] <= 1.0 - SURE and own[3] < 1.0 - SURE:
                out["absent", f"{effect}@{place}"] = 1.0 - share
    return out


def by_size(kept: Kept, others: Sequence[Kept]) -> Shares:
    out = Shares()
    for effect, places in kept["places"].items():
        for place in places:
            own = of(kept, effect, place)
            if own is None or len(own) < 6 or own[0] < SURE:
                continue
            theirs = [one for one in (of(other, effect, place) for other in others) if one and len(one) > 5]
            alike = [one for one in theirs if one[5].get("unit") == own[5].get("unit")]
            weight = np.array([one[0] for one in alike])
            if weight.sum() >= OTHERS:
                logs = np.array([one[5]["size"][0] for one in alike])
                out["size", f"{effect}@{place}"] = tail(own[5]["size"][0], logs, weight)
    return out


def by_constant(kept: Kept, others: Sequence[Kept]) -> Shares:
    out = Shares()
    for name, (x, *_) in kept["parameters"].items():
        theirs = [other["parameters"][name][0] for other in others if name in other["parameters"]]
        if len(theirs) >= OTHERS:
            out["parameter", name] = tail(x, np.array(theirs), np.ones(len(theirs)))
    return out


def tail(x: float, others: np.ndarray[Any, Any], weight: np.ndarray[Any, Any]) -> float:
    """Two-sided, of a next one after others that are normal."""
    n = weight.sum()
    mean = weight @ others / n
    sigma = np.sqrt(weight @ (others - mean) ** 2 / (n - 1.0) * (1.0 + 1.0 / n))
    return float(2.0 * student.sf(abs(x - mean) / sigma, n - 1.0))


def test_a_machine_that_has_what_no_other_has_is_odd_and_others_are_not() -> None:
    rng = np.random.default_rng(1)
    quiet = DrawnFleet(np.zeros(3), 5, -4.0)
    kept = [quiet.machine(rng) for _ in range(60)]
    kept[7]["places"]["backlash"]["q2"] = [0.99, 0.018, 9.0, 0.1, 1.0]
    kept[9]["parameters"]["c1"][0] = 9.0
    told = judged(kept)
    assert told[7].odd and told[7].reasons[0].name == "backlash@q2" and told[7].reasons[0].kind == "present"
    assert told[9].odd and told[9].reasons[0].name == "c1" and "+9.0 tolerances" in told[9].reasons[0].text
    assert sum(one.odd for one in told) <= 6  # one in twenty is called odd by chance


def test_a_machine_that_lacks_what_all_others_have_is_odd() -> None:
    rng = np.random.default_rng(1)
    kept = [DrawnFleet(np.zeros(1), 5, -4.0).machine(rng) for _ in range(600)]
    for one in kept[1:]:
        one["places"]["backlash"]["q1"] = [0.9999, 0.018, 13.0, 0.1, 1.0]
    kept[0]["places"]["backlash"]["q1"] = [0.0, 0.018, -9.0, 0.0, 1.0]
    told = judged(kept)[0]
    assert told.reasons[0].kind == "absent" and told.odd
    (alone,) = judged(kept[:1])
    assert not alone.odd and not alone.reasons and alone.score == 0.0
