"""``python -m benchmarks.mutation``: a seeded sample of mutants, how many the tests kill, and the table of them.

It goes on where it was stopped. The scratch folder belongs to one state of the code: remove it when the code has
changed. Files of tests that were added are collected; where a file of tests has changed, remove its record.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed

from . import areas, covering, running
from .mutants import Mutant
from .table import REASONS, written

ROOT = Path(__file__).resolve().parents[3]


def main() -> int:
    """Collect what tests cover, try the mutants that have no result yet, and write the table."""
    given = _arguments()
    scratch: Path = given.scratch.resolve()
    results = scratch / "results.jsonl"
    wanted = _samples(given, given.sample, given.seed)
    second = _samples(given, given.fresh, given.seed + 1)
    for old in scratch.glob("tree*/"):
        shutil.rmtree(old)  # tests may have been added
    tree = running.copied(ROOT, scratch / "tree")
    coverage = covering.collect(tree, scratch / "records", given.workers)
    known = _known(results)
    todo = [
        (area, mutant, *coverage.chosen(ROOT, mutant, given.budget))
        for area, mutant in _both(wanted, second)
        if mutant.key not in known or (given.again and known[mutant.key]["result"] == "survived")
    ]
    random.Random(given.seed).shuffle(todo)
    tried = Parallel(n_jobs=given.workers, return_as="generator_unordered")(
        delayed(_tried)(scratch, area, mutant, tests, seconds) for area, mutant, tests, seconds in todo
    )
    for n, result in enumerate(tried, start=1):
        with results.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(result) + "\n")
        sys.stdout.write(f"{n}/{len(todo)} {result['result']} {result['seconds']:.1f} s {result['key']}\n")
        sys.stdout.flush()
    known = _known(results)
    found, fresh = (
        {area: [known[m.key] for m in mutants if m.key in known] for area, mutants in sample.items()}
        for sample in (wanted, second)
    )
    given.output.write_text(written(found, fresh, vars(given) | {"commit": _commit()}), encoding="utf-8")
    sys.stdout.write(f"{given.output}; reasons in {REASONS}\n")
    return 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutation", description=__doc__)
    parser.add_argument("--sample", type=int, default=0, help="mutants, shared equally by the areas")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--fresh",
        type=int,
        default=0,
        help="mutants of another sample, from the seed after, that no test is for",
    )
    parser.add_argument("--only", nargs="*", choices=areas.AREAS, help="areas (default: all)")
    parser.add_argument(
        "--since", metavar="REVISION", help="only lines that changed since, in place of areas"
    )
    parser.add_argument("--budget", type=float, default=60.0, help="CPU seconds of tests a mutant")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--again", action="store_true", help="try survivors again, after tests were added")
    parser.add_argument(
        "--scratch", type=Path, default=Path("build/mutation"), help="copies, records, results"
    )
    parser.add_argument(
        "--output", type=Path, default=ROOT / "proof" / "benchmarks" / "results" / "mutation.md"
    )
    return parser.parse_args()


def _samples(given: argparse.Namespace, count: int, seed: int) -> dict[str, list[Mutant]]:
    if given.since:
        return {f"changed since {given.since}": areas.changed(ROOT, given.since, count, seed)}
    each = count // len(areas.AREAS)
    return {area: areas.sample(ROOT, area, each, seed) for area in given.only or areas.AREAS}


def _commit() -> str:
    """The code that was changed, as git names it."""
    command = ["git", "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def _both(*samples: dict[str, list[Mutant]]) -> list[tuple[str, Mutant]]:
    """The mutants of both, each once."""
    pairs = [(area, mutant) for sample in samples for area, mutants in sample.items() for mutant in mutants]
    return list({mutant.key: (area, mutant) for area, mutant in pairs}.values())


def _tried(scratch: Path, area: str, mutant: Mutant, tests: list[str], seconds: float) -> dict[str, Any]:
    result, used = running.outcome(ROOT, scratch, mutant, tests, seconds)
    return {
        "key": mutant.key,
        "area": area,
        "line": mutant.line,
        "result": result,
        "tests": len(tests),
        "seconds": round(used, 2),
    }


def _known(results: Path) -> dict[str, dict[str, Any]]:
    """The latest result of each mutant."""
    lines = results.read_text(encoding="utf-8").splitlines() if results.exists() else []
    return {row["key"]: row for row in map(json.loads, lines)}


if __name__ == "__main__":
    sys.exit(main())
