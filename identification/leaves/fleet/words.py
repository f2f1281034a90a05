"""What a run over a fleet says, in words and as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

from truepose.identification.leaves.fleet.changes import Changes
from truepose.identification.leaves.fleet.statistics import EffectInFleet, Interval, ToleranceInFleet
from truepose.identification.leaves.fleet.table import SHOWN, Fleet
from truepose.identification.report.json_text import Json
from truepose.identification.report.phrases import percent, significant, title, unit_symbol
from truepose.wording import joined, shortened

SCHEMA = "truepose/fleet/1"
MET, UNMET = 0.9, 0.1
"""Probabilities from, and up to, which a tolerance is said to be met, or not to be: the level at which reports speak."""
NAMED = 6
_STATUSES: Mapping[str, str] = {
    "done": "diagnosed",
    "refused": "diagnosed, but no calibration",
    "wrong": "whose files do not belong together",
    "failed": "that could not be worked with",
    "broken": "stopped by a fault (tried again next time)",
}


def fleet_json(fleet: Fleet) -> Json:
    """The content of ``fleet.json``; the machines themselves are in ``fleet.csv``."""
    told, statuses = fleet.statistics, fleet.count("status")
    odd = fleet.odd.head(SHOWN)[["name", "oddness", "odd_because"]]
    undone = fleet.undone.head(SHOWN)[["name", "status", "why"]]
    return {
        "schema": SCHEMA,
        "fleet": fleet.name,
        "machines": len(fleet.table),
        "statuses": {name: statuses[name] for name in _STATUSES if name in statuses},
        "verdicts": fleet.count("verdict"),
        "effects": [asdict(one) for one in told.anywhere],
        "places": [asdict(one) for one in told.places],
        "tolerances": [asdict(one) for one in told.tolerances],
        "constants": [asdict(one) for one in told.constants],
        "odd": odd.rename(columns={"odd_because": "because"}).to_dict("records"),
        "undone": undone.to_dict("records"),
        "changes": fleet.changes and asdict(fleet.changes),
    }


def headline(fleet: Fleet) -> str:
    """The result in one sentence."""
    machines, verdicts = len(fleet.table), fleet.count("verdict")
    if not fleet.diagnosed:
        return f"None of {machines} machines could be diagnosed."
    missing, unknown = verdicts.get("missing-physics", 0), verdicts.get("unknown", 0)
    parts = [f"physics is missing in {missing}"] if missing else []
    parts += [f"something unknown in {unknown}"] if unknown else []
    said = joined(parts) if parts else "the model is adequate in all"
    return f"{fleet.diagnosed} of {machines} machines diagnosed: {said}."


def effect_sentence(one: EffectInFleet) -> str:
    """``backlash (backlash): in 34 % of machines (28 % to 41 %); median 4.2×10⁻⁴ rad (...)``."""
    where = f" at {' + '.join(one.place)}" if one.place else ""
    often = f"in {percent(one.frequency.value)} of machines ({percent_range(one.frequency)}; expected {percent(one.usual)})"
    size = size_words(one)
    return f"{title(one.effect)} ({one.effect}){where}: {often}{f'; {size}' if size else ''}."


def size_words(one: EffectInFleet) -> str:
    """The fleet's median with its interval, and by which factor machines differ; empty where it is hardly ever there."""
    sized, unit = (one.amount, one.unit) if one.amount is not None else (one.size, "")
    if sized is None:
        return ""
    low, high = significant(sized.low), significant(sized.high)
    tail = unit_symbol(unit) if one.amount is not None else "of what the catalogue expects at most"
    spread = f", one sigma between machines {significant(one.spread, 2)} times" if one.spread else ""
    return f"median {significant(sized.value)} ({low} to {high}) {tail}".rstrip() + spread


def percent_range(interval: Interval) -> str:
    """From where to where a share may be; once where both ends read alike."""
    low, high = percent(interval.low), percent(interval.high)
    return low if low == high else f"{low} to {high}"


def tolerance_sentence(one: ToleranceInFleet) -> str:
    """Whether a class of parts is built as its tolerances say."""
    if one.met >= MET:
        said = "met"
    else:
        said = "not met" if one.met <= UNMET else "open"
    low, high = significant(one.ratio.low, 2), significant(one.ratio.high, 2)
    spread = f"true spread {significant(one.ratio.value, 2)} ({low} to {high}) of the stated tolerance"
    return f"{one.parts}: {said}; {spread}, {one.deviations} constants."


def status_sentences(fleet: Fleet) -> list[str]:
    """Machines that are no plain success, by what became of them."""
    statuses = fleet.count("status")
    counts = [(statuses.get(name, 0), words) for name, words in _STATUSES.items() if name != "done"]
    return [f"{count} {'machine' if count == 1 else 'machines'} {words}." for count, words in counts if count]


def change_sentences(changes: Changes | None) -> list[str]:
    """What changed since the last run, in short."""
    if changes is None:
        return ["The first run in this folder: nothing to compare with."]
    if not changes.any:
        again = f", though {changes.again} machines were worked with again" if changes.again else ""
        return [f"Nothing has changed since the last run{again}."]
    out = [f"New: {shortened(changes.new, NAMED)}."] if changes.new else []
    out += [f"Gone: {shortened(changes.gone, NAMED)}."] if changes.gone else []
    for what, words in (
        ("status", "Otherwise done"),
        ("verdict", "Other verdict"),
        ("findings", "Other findings"),
    ):
        names = [one.machine for one in changes.said if one.what == what]
        out += [f"{words}: {shortened(names, NAMED)}."] if names else []
    names = list(dict.fromkeys(one.machine for one in changes.moved))
    moved = f"{len(changes.moved)} of {changes.compared} parameters moved by more than {significant(changes.limit, 2)} sigma"
    return [*out, f"{moved}: {shortened(names, NAMED)}."] if names else out


def often(one: EffectInFleet) -> bool:
    """Whether an effect is there in a machine, rather than not: surely, or likelier than was expected of it."""
    return one.frequency.low * one.machines >= 0.5 or (one.found >= 0.5 and one.frequency.value > one.usual)
