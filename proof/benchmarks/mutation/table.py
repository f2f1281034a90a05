"""The table benchmarks/results/mutation.md: killed by area, and every survivor with the reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

REASONS = Path(__file__).with_name("survivors.yaml")
HEAD = """# Tests that guard: a mutation run

`python -m benchmarks.mutation {asked}` makes small changes (an operator swapped, a number
doubled, or one higher below ten, a condition turned round, a statement left out) one at a time, and runs the tests that run the
line, for at most {budget:g} CPU seconds each. Timeouts count as killed. {tried} were tried, on commit {commit}.
An *equivalent* mutant does the same as the code, or differs by rounding; no test can kill it.
"""
COLUMNS = """| area | mutants | killed | survived | timeouts | equivalent | killed | of those not equivalent |
|---|---|---|---|---|---|---|---|
"""
SAMPLE = """
## A sample

Tests were written against its survivors, which flatters it.

"""
FRESH = """
## A fresh sample

No test was written for it: what it says of the tests as they were. Laws that were written since are named.

"""
ASKED = ("since", "sample", "fresh", "seed", "budget", "only")
"""Options that say which mutants, and how long they have tests."""
Results = Mapping[str, Sequence[Mapping[str, Any]]]
"""Results of mutants by area."""


def written(found: Results, fresh: Results, options: Mapping[str, Any]) -> str:
    """The page, from the results of a sample, of one that no test was written for, and the options of the command."""
    reasons: dict[str, str] = yaml.safe_load(REASONS.read_text(encoding="utf-8")) or {}
    asked = " ".join(f"--{name} {_word(options[name])}" for name in ASKED if options[name])
    tried = sum(len(results) for sample in (found, fresh) for results in sample.values())
    page = HEAD.format(**{**options, "asked": asked}, tried=tried)
    for title, sample in ((SAMPLE, found), (FRESH, fresh)):
        if any(sample.values()):
            page += title + _table(sample, reasons) + "\n" + _survivors(sample, reasons)
    return page


def _word(value: object) -> str:
    """Return an option's value as it is typed."""
    return (
        " ".join(value)
        if isinstance(value, list)
        else f"{value:g}"
        if isinstance(value, float)
        else str(value)
    )


def _table(found: Results, reasons: Mapping[str, str]) -> str:
    rows = {area: _row(results, reasons) for area, results in found.items()}
    rows["all"] = _row([r for results in found.values() for r in results], reasons)
    return COLUMNS + "".join(f"| {area} | {row} |\n" for area, row in rows.items())


def _survivors(found: Results, reasons: Mapping[str, str]) -> str:
    return "".join(
        f"* `{r['key'].replace('`', '')}` (line {r['line']}): {reasons.get(r['key'], 'not looked at')}\n"
        for results in found.values()
        for r in sorted(results, key=lambda r: (r["key"].partition(":")[0], r["line"]))
        if r["result"] == "survived"
    )


def _row(results: Sequence[Mapping[str, Any]], reasons: Mapping[str, str]) -> str:
    def count(name: str) -> int:
        return sum(r["result"] == name for r in results)

    killed, survived, timeouts = count("killed"), count("survived"), count("timeout")
    same = sum(
        r["result"] == "survived" and reasons.get(r["key"], "").startswith("equivalent") for r in results
    )
    share, fair = ((killed + timeouts) / max(n, 1) for n in (len(results), len(results) - same))
    return f"{len(results)} | {killed} | {survived} | {timeouts} | {same} | {100 * share:.0f} % | {100 * fair:.0f} %"
