"""The table docs/mutation.md: killed by area, and every survivor with the reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

REASONS = Path(__file__).with_name("survivors.yaml")
HEAD = """# Tests that guard: a mutation run

`python -m benchmarks.mutation --sample {sample} --seed {seed}` makes small changes (an operator swapped, a number
doubled, or one higher below ten, a condition turned round, a statement left out) one at a time, and runs the tests that run the
line, for at most {budget} CPU seconds each. Timeouts count as killed. {tried} of the sample were tried so far. An
*equivalent* mutant does the same as the code, or differs by rounding; no test can kill it.

| area | mutants | killed | survived | timeouts | equivalent | killed | of those not equivalent |
|---|---|---|---|---|---|---|---|
"""


def written(found: Mapping[str, Sequence[Mapping[str, Any]]], sample: int, seed: int, budget: str) -> str:
    """The page, from the results of each area."""
    reasons: dict[str, str] = yaml.safe_load(REASONS.read_text(encoding="utf-8")) or {}
    rows = {area: _row(results, reasons) for area, results in found.items()}
    rows["all"] = _row([r for results in found.values() for r in results], reasons)
    lines = [f"| {area} | {row} |" for area, row in rows.items()]
    tried = sum(map(len, found.values()))
    survivors = [
        f"* `{r['key'].replace('`', '')}` (line {r['line']}): {reasons.get(r['key'], 'not looked at')}"
        for results in found.values()
        for r in sorted(results, key=lambda r: (r["key"].partition(":")[0], r["line"]))
        if r["result"] == "survived"
    ]
    return (
        HEAD.format(sample=sample, seed=seed, tried=tried, budget=budget)
        + "\n".join(lines)
        + "\n\n## Survivors\n\n"
        + "\n".join(survivors)
        + "\n"
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
