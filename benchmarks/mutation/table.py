"""The table benchmarks/results/mutation.md: killed by area, and every survivor with the reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

REASONS = Path(__file__).with_name("survivors.yaml")
HEAD = """# Tests that guard: a mutation run

`python -m benchmarks.mutation --sample {sample} --seed {seed}{more}` makes small changes (an operator swapped, a number
doubled, or one higher below ten, a condition turned round, a statement left out) one at a time, and runs the tests that run the
line, for at most {budget:g} CPU seconds each. Timeouts count as killed. {tried} of the sample were tried, on commit {commit}.
An *equivalent* mutant does the same as the code, or differs by rounding; no test can kill it.

"""
COLUMNS = """| area | mutants | killed | survived | timeouts | equivalent | killed | of those not equivalent |
|---|---|---|---|---|---|---|---|
"""
FRESH = """
## Another sample

Tests were written against survivors of the sample above, which flatters it. This is another one, from the seed after,
that no test had been written for: what it says of the tests as they were. Laws that were written since are named.

"""
Results = Mapping[str, Sequence[Mapping[str, Any]]]
"""Results of mutants by area."""


def written(found: Results, fresh: Results, options: Mapping[str, Any]) -> str:
    """The page, from the results of a sample, of one that no test was written for, and the options of the command."""
    reasons: dict[str, str] = yaml.safe_load(REASONS.read_text(encoding="utf-8")) or {}
    more = f" --fresh {options['fresh']}" if any(fresh.values()) else ""
    head = HEAD.format(**{**options, "more": more}, tried=sum(map(len, found.values())))
    page = head + _table(found, reasons) + "\n## Survivors\n\n" + _survivors(found, reasons)
    return page + FRESH + _table(fresh, reasons) + "\n" + _survivors(fresh, reasons) if more else page


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
