"""What is said of a drift: times, rates and sizes in their units, how long calibrations last, and when to renew what."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.told_drift import BAD, CHANGED, DAY, GOOD, NAMES, WORSE, blind, movement, told_drift
from truepose.identification.identifiability.observability import Direction
from truepose.identification.leaves.drift.durability import Check
from truepose.identification.leaves.drift.words import (
    advice,
    drift_json,
    drift_notes,
    durability_sentences,
    headline,
    moved_sentences,
    movement_sentence,
    place,
    span,
    still_sentences,
    traded_sentences,
)

MINUTE, HOUR = 60.0, 3600.0


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (0.5, "0.50 s"),
        (1.0, "1 second"),
        (45.0, "45.0 seconds"),
        (MINUTE, "1 minute"),
        (90.0, "1.5 minutes"),
        (HOUR - 1.0, "1 hour"),
        (HOUR, "1 hour"),
        (9.5 * HOUR, "9.5 hours"),
        (10 * HOUR, "10.0 hours"),
        (DAY, "1 day"),
        (8 * DAY, "8 days"),
        (31.4 * DAY, "31.4 days"),
    ],
)
def test_a_span_of_time_is_told_in_the_largest_unit_that_fills_one(seconds: float, said: str) -> None:
    """However late the clock was started."""
    for start in (0.0, 5e6):
        told = told_drift(times=(start, start + seconds), carried=(GOOD,), frames=(GOOD,))
        text = span(told, 1)
        assert text.replace(".0 ", " ") == said.replace(".0 ", " ")
        assert place(told, 1) == f"s1 ({text})"
    assert place(told_drift(times=None), 1) == "s1"


def test_the_headline_counts_what_moved_and_says_over_which_time() -> None:
    one, two = movement("a", "moved"), movement("b", "moved")
    others = [movement("c", "perhaps"), movement("d", "still")]
    assert (
        headline(told_drift(*others))
        == "arm: 3 sessions over 3 days: nothing moved (noise 1.0 times the stated)"
    )
    assert ": 1 parameter moved (" in headline(told_drift(one, *others))
    assert ": 2 parameters moved (" in headline(told_drift(one, two, *others))
    assert headline(told_drift(times=None)) == "arm: 3 sessions: nothing moved (noise 1.0 times the stated)"


def test_notes_tell_noise_beyond_the_stated_and_a_fit_that_did_not_settle() -> None:
    assert drift_notes(told_drift(notes=("a note",), noise=1.5)) == ["a note"]
    (said,) = drift_notes(told_drift(noise=1.6))
    assert said.startswith("residuals are 1.6 times the stated noise")
    (said,) = drift_notes(told_drift(settled=False))
    assert said == "the joint fit still moved after 4 rounds; sizes are approximate"


@pytest.mark.parametrize(
    ("times", "rate"),
    [
        (None, "20.0 ± 1.0 µm a session"),
        ((0.0, DAY, 2 * DAY), "0.833 ± 0.042 µm an hour"),
        ((0.0, DAY, 2.1 * DAY), "20.0 ± 1.0 µm a day"),
        ((10 * DAY, 11 * DAY, 11.5 * DAY), "0.833 ± 0.042 µm an hour"),
    ],
)
def test_a_rate_is_by_the_day_over_more_than_two_days_and_by_the_session_without_a_clock(
    times: tuple[float, ...] | None, rate: str
) -> None:
    by_session = {"rate": 0.02, "rate_std": 0.001} if times is None else {}
    own = movement("a", "moved", **{**CHANGED, **by_session})
    told = told_drift(own, times=times)
    up_to = "s2" if times is None else place(told, 2)
    said = movement_sentence(told, own)
    assert said == f"a: 60.0 ± 1.0 µm up to {up_to}, {rate}, probability 99.0 %"
    uneven = movement_sentence(told, replace(own, steady=False))
    assert uneven == said.replace(rate, f"{rate}, not evenly")
    for gone in ({"rate": None}, {"rate_std": None}):
        assert ", no rate, " in movement_sentence(told, replace(own, **gone))  # type: ignore[arg-type]
    still = replace(own, change=(), std=())
    assert movement_sentence(told, still) == "a: not in the likeliest set, probability 99.0 %"


@pytest.mark.parametrize(
    ("change", "std", "said"),
    [
        ((0.0, 0.02, 0.06), (0.0, 0.001, 0.001), "60.0 ± 1.0 µm up to s2 (3 days)"),
        ((0.0, -0.06, 0.02), (0.0, 0.001, 0.001), "-60.0 ± 1.0 µm up to s1 (1 day)"),
        ((0.0, 0.062, 0.06), (0.0, 0.001, 0.001), "60.0 ± 1.0 µm up to s2 (3 days)"),
        ((0.0, 0.06, 0.05), (0.0, 0.001, 0.001), "60.0 ± 1.0 µm up to s1 (1 day)"),
        ((0.0, 0.05, 0.06), (0.0, 0.001, 0.010), "50.0 ± 1.0 µm up to s1 (1 day)"),
        ((1.0, 0.05, 0.06), (1e-3, 0.001, 0.001), "60.0 ± 1.0 µm up to s2 (3 days)"),
    ],
)
def test_the_session_at_which_a_movement_is_clearest_is_told(
    change: tuple[float, ...], std: tuple[float, ...], said: str
) -> None:
    """The last, where it is nearly as clear as any; never the first, from which changes are counted."""
    own = movement("a", "moved", change=change, std=std)
    assert said in movement_sentence(told_drift(own), own)


def test_what_could_have_moved_instead_is_told_with_its_odds() -> None:
    odds = {
        name: float(np.log(value)) for name, value in zip("bcdefg", (0.3, 2, 21.4, 234, 5, 6), strict=True)
    }
    own = movement("a", "moved", **CHANGED, alike=odds)
    said = movement_sentence(told_drift(own), own).partition("; or ")[2]
    assert said == ("b (odds 1:1), c (odds 1:2), d (odds 1:21), e (odds 1:230) or 2 more instead")
    four = replace(own, alike=dict(list(odds.items())[:4]))
    assert movement_sentence(told_drift(four), four).endswith("; or " + said.replace(" or 2 more", ""))
    alone = replace(own, alike={})
    assert "; or" not in movement_sentence(told_drift(alone), alone)


def test_frames_and_the_mechanism_are_told_apart() -> None:
    frame, joint = movement("base.x", "moved", extrinsic=True), movement("q2.r", "moved")
    assert moved_sentences(told_drift(frame)) == [
        "of frames and sensors: base.x",
        "of the mechanism: nothing",
    ]
    assert moved_sentences(told_drift(joint)) == ["of frames and sensors: nothing", "of the mechanism: q2.r"]
    anew = movement("tool.z", "anew", extrinsic=True)
    set_up = "set up anew for each session, as the machine file says: tool.z"
    assert moved_sentences(told_drift(anew)) == [set_up]
    assert moved_sentences(told_drift(anew, joint))[0] == set_up
    assert moved_sentences(told_drift(movement("q1.r", "perhaps"))) == []


def test_what_stayed_hidden_is_told_by_two_sigmas_and_by_the_reason() -> None:
    still = [movement(f"q{k}.r", "still", hidden=0.001 * k) for k in range(1, 14)]
    (said,) = still_sentences(told_drift(*still, movement("a", "moved"), movement("b", "perhaps")))
    assert said.startswith("no movement shown of (alone, it would show from): q1.r (2.0 µm), q2.r (4.0 µm), ")
    assert said.endswith("q12.r (24 µm) and 1 more")
    others = [movement("c", "masked"), movement("d", "unseen", hidden=np.inf), movement("e", "masked")]
    assert still_sentences(told_drift(*others)) == [
        "a movement of c, e could not be told from those found",
        "no recording sees d: a movement there cannot be told",
    ]


def test_at_most_five_combinations_that_nobody_sees_are_told() -> None:
    pairs = [Direction({NAMES[2 * k]: 1.0, NAMES[2 * k + 1]: -1.0}) for k in range(7)]
    alone = Direction({NAMES[14]: 1.0})
    for count, more in ((1, 0), (5, 0), (6, 1), (7, 2)):
        said = traded_sentences(told_drift(unseen=blind(*pairs[:count], alone)))
        told = [text for text in said if text.startswith("a movement along this would not be noticed: ")]
        assert len(told) == min(count, 5) and all("o" not in text.split(":")[1].split()[0] for text in told)
        rest = [f"and {more} more combinations (drift.json has all)"] if more else []
        assert said[len(told) :] == rest
    assert traded_sentences(told_drift(unseen=blind(alone))) == []


@pytest.mark.parametrize(
    ("checks", "said"),
    [
        ([GOOD, GOOD, GOOD, GOOD], "suffices up to s4"),
        ([GOOD, GOOD, BAD, WORSE], "suffices up to s2; no longer at s3: {bad}; at s4: {worse}"),
        ([GOOD, BAD, GOOD, GOOD], "suffices up to s1; no longer at s2: {bad}; though again at s3, s4"),
        (
            [BAD, GOOD, GOOD, WORSE],
            "does not suffice even at s1: {bad}; though again at s2, s3; at s4: {worse}",
        ),
        ([BAD, BAD, WORSE, WORSE], "does not suffice even at s1: {bad}; at s4: {worse}"),
        ([GOOD, None, BAD, None], "suffices up to s1; no longer at s3: {bad}; no fit was found for s2, s4"),
        ([None, None, None, None], "no fit was found for s1, s2, s3, s4"),
    ],
)
def test_how_long_a_calibration_suffices(checks: list[Check | None], said: str) -> None:
    sizes = {"bad": "30.0", "worse": "50.0"}
    misfits = {k: f"rms position {v} µm against 10.0 µm expected" for k, v in sizes.items()}
    told = told_drift(times=None, carried=checks, frames=[GOOD] * 4)
    first, second, *_ = durability_sentences(told)
    assert first == f"the calibration of s0 as it is {said.format(**misfits)}"
    assert second == "re-identifying the frames and sensor constants alone suffices up to s4"


@pytest.mark.parametrize(
    ("carried", "frames", "said"),
    [
        ("++++", "++++", "no recalibration is due up to s4 (4 days)"),
        ("?+++", "-+++", "no recalibration is due up to s4 (4 days)"),
        (
            "-+++",
            "++++",
            "recalibrate frames and sensor constants within 1 day; the mechanism's constants hold throughout",
        ),
        (
            "++-+",
            "+++-",
            "recalibrate frames and sensor constants after 2 days, within 3 days, everything after 3 days, within 4 days",
        ),
        (
            "?+--",
            "?+--",
            "recalibrate everything after 2 days, within 3 days: frames and sensor constants alone would not do",
        ),
    ],
)
def test_advice_follows_from_the_first_check_that_fails(carried: str, frames: str, said: str) -> None:
    checks = {"+": GOOD, "-": BAD, "?": None}
    told = told_drift(
        times=[k * DAY for k in range(5)],
        carried=[checks[c] for c in carried],
        frames=[checks[c] for c in frames],
    )
    assert advice(told) == said
    assert durability_sentences(told)[-1] == said


def test_advice_without_a_clock_names_sessions() -> None:
    told = told_drift(times=None, carried=(GOOD, BAD), frames=(GOOD, GOOD))
    assert advice(told).startswith("recalibrate frames and sensor constants before s2;")
    assert advice(told_drift(times=None)) == "no recalibration is due up to s2"


def test_the_document_has_every_session_with_what_it_read_and_when() -> None:
    own = movement("a", "moved", **CHANGED, alike={"b": 0.7})
    told = told_drift(own, carried=(GOOD, None), unseen=blind(Direction({"a": 1.0, "b": -1.0})))
    document = drift_json(told)
    assert document["sessions"] == [
        {"label": f"s{k}", "time": time, "readings": 30 + k} for k, time in enumerate((0.0, DAY, 3 * DAY))
    ]
    assert document["parameters"]["a"]["rate"] == {"value": own.rate, "std": own.rate_std, "unit": "mm/s"}
    assert [one["session"] for one in document["durability"]] == ["s1", "s2"]
    first, second = document["durability"]
    assert first["carried"] == {
        "rms": {"position": 0.011},
        "expected": {"position": 0.01},
        "p": 0.4,
        "suffices": True,
    }
    assert second["carried"] is None and second["frames"] is not None
    assert document["unseen"][0]["parts"] == {"a": 1.0, "b": -1.0}
    bare = drift_json(replace(told, times=None, movements=(replace(own, rate=None),)))
    assert [one["time"] for one in bare["sessions"]] == [None] * 3
    assert bare["parameters"]["a"]["rate"] is None
    session = drift_json(replace(told, times=None))
    assert session["parameters"]["a"]["rate"]["unit"] == "mm/session"
