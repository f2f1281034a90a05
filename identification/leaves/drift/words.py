"""What moved, how long calibrations last and when to recalibrate: sentences and JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from truepose.identification.leaves.drift.analysis import ROUNDS, Drift
from truepose.identification.leaves.drift.sizes import Check, Movement
from truepose.identification.report.identifiability_words import grouped, meaning, unseen_sentences
from truepose.identification.report.json_text import Json, finite
from truepose.identification.report.notes import worded
from truepose.identification.report.phrases import measure, percent, significant, uncertain
from truepose.wording import shortened

SCHEMA = "truepose/drift/1"
HOUR, DAY = 3600.0, 86400.0
WHOLE = 0.9995
"""As much of an hour is an hour: it would be written as 60.0 minutes."""
NOISY = 1.5
"""Noise, in stated sigmas, above which physics that the model lacks may show as movement."""
SHOWN = 12
TRADED = 5
ALIKE = 4
WAYS = {
    "carried": "the calibration of {first} as it is",
    "frames": "re-identifying the frames and sensor constants alone",
}


def drift_notes(found: Drift) -> list[str]:
    """What a reader must know before the result."""
    out = worded(found.notes)
    if found.noise > NOISY:
        out.append(
            f"residuals are {found.noise:.2g} times the stated noise: either it is stated too small or the model lacks"
            " physics, which differs between sets of poses and may show as movement (truepose diagnose looks for it)"
        )
    if not found.settled:
        out.append(f"the joint fit still moved after {ROUNDS} rounds; sizes are approximate")
    return out


def headline(found: Drift) -> str:
    """Recordings, span, and how many parameters moved."""
    over = f" over {span(found, len(found.labels) - 1)}" if found.times else ""
    moved = len(found.moved)
    said = f"{moved} parameter{'s' if moved != 1 else ''} moved" if moved else "nothing moved"
    noise = f"noise {significant(found.noise, 2)} times the stated"
    return f"{found.machine}: {len(found.labels)} sessions{over}: {said} ({noise})"


def moved_sentences(found: Drift) -> list[str]:
    """Which frames and parts of sensors moved, and which constants of the mechanism."""
    out = []
    for extrinsic, whose in ((True, "frames and sensors"), (False, "the mechanism")):
        moved = [m.name for m in found.moved if m.extrinsic is extrinsic]
        out.append(f"of {whose}: {', '.join(grouped(moved)) if moved else 'nothing'}")
    anew = [m.name for m in found.movements if m.status == "anew"]
    stated = (
        [f"set up anew for each session, as the machine file says: {', '.join(grouped(anew))}"]
        if anew
        else []
    )
    return [*stated, *(out if found.moved else [])]


def movement_sentence(found: Drift, movement: Movement) -> str:
    """``q4.beta: -160 +- 0.5 urad up to day8.csv (8 days), ...``."""
    sure = f"probability {percent(movement.probability)}"
    if not movement.change:
        return f"{movement.name}: not in the likeliest set, {sure}"
    text = f"{movement.name}: {_amount(found, movement)}, {_rate(found, movement)}, {sure}"
    alike = [f"{name} (odds 1:{_round(np.exp(odds))})" for name, odds in movement.alike.items()]
    more = f" or {len(alike) - ALIKE} more" if len(alike) > ALIKE else ""
    return text + (f"; or {', '.join(alike[:ALIKE])}{more} instead" if alike else "")


def _round(value: float) -> str:
    """Two digits, and never a fraction."""
    return f"{float(f'{max(value, 1.0):.1e}'):.0f}"


def _amount(found: Drift, movement: Movement) -> str:
    sizes = np.abs(movement.change) / np.maximum(movement.std, 1e-300)
    sizes[0] = 0.0
    last = len(sizes) - 1
    furthest = last if sizes[last] >= 0.9 * np.max(sizes) else int(np.argmax(sizes))
    moved = uncertain(movement.change[furthest], movement.std[furthest], movement.unit)
    return f"{moved} up to {place(found, furthest)}"


def _rate(found: Drift, movement: Movement) -> str:
    if movement.rate is None or movement.rate_std is None:
        return "no rate"
    factor, per = rate_unit(found)
    text = uncertain(movement.rate * factor, movement.rate_std * factor, movement.unit)
    return f"{text}{per}" + ("" if movement.steady else ", not evenly")


def rate_unit(found: Drift) -> tuple[float, str]:
    """Factor from the rate per second (or session), and how the unit is written."""
    if found.times is None:
        return 1.0, " a session"
    return (DAY, " a day") if found.times[-1] - found.times[0] > 2 * DAY else (HOUR, " an hour")


def still_sentences(found: Drift) -> list[str]:
    """What did not move, with the largest movement that could have stayed hidden, and what nobody sees."""
    still = [m for m in found.movements if m.status == "still"]
    shown = shortened([f"{m.name} ({measure(2 * m.hidden, m.unit, 2)})" for m in still], SHOWN)
    out = []
    if still:
        out.append(f"no movement shown of (alone, it would show from): {shown}")
    unseen = [m.name for m in found.movements if m.status == "unseen"]
    masked = [m.name for m in found.movements if m.status == "masked"]
    if masked:
        out.append(f"a movement of {', '.join(grouped(masked))} could not be told from those found")
    if unseen:
        out.append(f"no recording sees {', '.join(grouped(unseen))}: a movement there cannot be told")
    return [*out, *traded_sentences(found)]


def traded_sentences(found: Drift) -> list[str]:
    """Combinations that no recording sees: a movement along them would stay unnoticed."""
    blind = found.unseen
    several = replace(blind, directions=tuple(d for d in blind.directions if len(d.parts) > 1))
    said = unseen_sentences(several)
    more = [f"and {len(said) - TRADED} more combinations (drift.json has all)"] if len(said) > TRADED else []
    return [f"a movement along this would not be noticed: {text}" for text in said[:TRADED]] + more


def durability_sentences(found: Drift) -> list[str]:
    """For each way to keep up: how long it suffices, and from when on it does not."""
    out = []
    for way, subject in WAYS.items():
        checks = getattr(found.durability, way)
        out.append(_lasting(found, subject.format(first=found.labels[0]), checks))
    return [*out, advice(found)]


def _lasting(found: Drift, subject: str, checks: Sequence[Check | None]) -> str:
    states = [(k, check) for k, check in enumerate(checks, start=1) if check is not None]
    bad = [(k, check) for k, check in states if not check.holds]
    good = [k for k, check in states if check.holds]
    before = [k for k in good if not bad or k < bad[0][0]]
    parts = [f"suffices up to {place(found, before[-1])}"] if before else []
    if bad:
        start = "no longer" if before else "does not suffice even"
        parts.append(f"{start} at {place(found, bad[0][0])}: {_misfit(bad[0][1])}")
        again = [found.labels[k] for k in good if k > bad[0][0]]
        parts += [f"though again at {', '.join(again)}"] if again else []
        parts += [f"at {place(found, bad[-1][0])}: {_misfit(bad[-1][1])}"] if len(bad) > 1 else []
    lost = [found.labels[k] for k, check in enumerate(checks, start=1) if check is None]
    parts += [f"no fit was found for {', '.join(lost)}"] if lost else []
    return f"{subject} {'; '.join(parts)}"


def _misfit(check: Check) -> str:
    kinds = [
        f"{kind} {measure(value, unit)} against {measure(check.expected[kind], unit)} expected"
        for kind, value in check.rms.items()
        for unit in (check.units[kind],)
    ]
    return f"rms {', '.join(kinds)}"


def advice(found: Drift) -> str:
    """When to recalibrate what."""
    first = {way: _first_failure(getattr(found.durability, way)) for way in WAYS}
    if first["carried"] is None:
        return f"no recalibration is due up to {place(found, len(found.labels) - 1)}"
    when = _before(found, first["carried"])
    if first["frames"] is None:
        return f"recalibrate frames and sensor constants {when}; the mechanism's constants hold throughout"
    if first["frames"] == first["carried"]:
        return f"recalibrate everything {when}: frames and sensor constants alone would not do"
    return f"recalibrate frames and sensor constants {when}, everything {_before(found, first['frames'])}"


def _first_failure(checks: Sequence[Check | None]) -> int | None:
    return next((k for k, c in enumerate(checks, start=1) if c is not None and not c.holds), None)


def _before(found: Drift, k: int) -> str:
    if found.times is None:
        return f"before {found.labels[k]}"
    return f"within {span(found, k)}" if k == 1 else f"after {span(found, k - 1)}, within {span(found, k)}"


def place(found: Drift, k: int) -> str:
    """A session with the time since the first."""
    return f"{found.labels[k]} ({span(found, k)})" if found.times else found.labels[k]


def span(found: Drift, k: int) -> str:
    """Time from the first session to the k-th."""
    assert found.times is not None
    seconds = found.times[k] - found.times[0]
    for size, name in ((DAY, "day"), (HOUR, "hour"), (60.0, "minute"), (1.0, "second")):
        if seconds >= size * WHOLE:
            count = max(seconds / size, 1.0)
            text = significant(count, 2 if count < 10 else 3).removesuffix(".0")
            return f"{text} {name}{'' if text == '1' else 's'}"
    return f"{significant(seconds, 2)} s"


def drift_json(found: Drift) -> Json:
    """The content of ``drift.json``: mm, rad, s."""
    durable = found.durability
    out = {
        "schema": SCHEMA,
        "machine": found.machine,
        "sessions": [
            {
                "label": label,
                "time": found.times[k] if found.times else None,
                "readings": found.n_observations[k],
            }
            for k, label in enumerate(found.labels)
        ],
        "noise": found.noise,
        "log_bayes_factor": found.log_bayes_factor,
        "moved": [m.name for m in found.moved],
        "parameters": {m.name: _movement(found, m) for m in found.movements},
        "unseen": [{"parts": dict(d.parts), "meaning": meaning(d)} for d in found.unseen.directions],
        "durability": [
            {
                "session": found.labels[k + 1],
                "carried": _check(durable.carried[k]),
                "frames": _check(durable.frames[k]),
                "full": _check(durable.full[k]),
            }
            for k in range(len(durable.full))
        ],
        "sentences": durability_sentences(found),
        "notes": drift_notes(found),
    }
    return dict(finite(out))


_OF_MOVEMENTS = (
    "status", "probability", "extrinsic", "log_bayes_factor", "unit", "change", "std", "rate", "steady", "hidden", "alike",
)  # fmt: skip


def _movement(found: Drift, m: Movement) -> Json:
    per = "s" if found.times else "session"
    rate = None if m.rate is None else {"value": m.rate, "std": m.rate_std, "unit": f"{m.unit}/{per}"}
    return {**{name: getattr(m, name) for name in _OF_MOVEMENTS}, "rate": rate}


def _check(check: Check | None) -> Json | None:
    if check is None:
        return None
    return {
        "rms": dict(check.rms),
        "expected": dict(check.expected),
        "p": check.p,
        "suffices": check.holds,
    }
