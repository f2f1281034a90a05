"""Up to a million calls of each of the generated C's functions with hostile input, under ASan and UBSan: codes and findings.

    python -m benchmarks.hostile_c --rounds 1000000 -o benchmarks/results/hostile_c.md

What is tried is in ``tests/lib/support/hostile.c``. Functions that search take far longer where there is nothing to
find, and are called in fewer of the rounds. Exit code 1 where a promise is broken.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from support.generated_c import SANITIZERS
from support.generated_machines import machine_of
from support.hostile import Answers, answers, hostile_program
from truepose.codegen.features import ALL
from truepose.codegen.printer import Real
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

FLAGS = ["-O1", "-g", *SANITIZERS]
MOUNT = """schema: truepose/machine/1
name: mount
mechanism:
  type: mount
  kind: alt-az
  latitude: 39
  first: {offset: 3, range: [-20, 200]}
  second: {offset: -1, tilt: 0.3, range: [-80, 260]}
frames: {base: {in: world, rpy: [0.4, -0.2, 0]}, tool: {in: flange, rpy: [0, 0, 0.5]}}
sensor: {type: direction, sigma: {angle: 1 arcsec}}
"""


@dataclass(frozen=True)
class Case:
    """A program: its machine, what is generated, the share of the rounds that it gets, and in one of how many of these an
    inverse, all inverses, and batches are asked for."""

    machine: str
    what: str
    real: Real
    features: str | None
    share: float
    every: tuple[int, int, int]


_REALS: tuple[Real, Real] = ("double", "float")
CASES = (
    *(Case("arm", "arm of six joints", real, None, 1.0, (2000, 8000, 8000)) for real in _REALS),
    *(Case("arm", "arm of six joints", real, "warm", 1.0, (1, 1, 1)) for real in _REALS),
    *(Case("rails", "hexapod on rails", real, None, 0.01, (5, 1, 100)) for real in _REALS),
    *(Case("rails", "hexapod on rails", real, "warm,p,state", 0.01, (1, 1, 1)) for real in _REALS),
    *(Case("mount", "telescope mount", real, None, 1.0, (1000, 1, 8000)) for real in _REALS),
)
_HEAD = "| machine | C | function | calls | 0 | 1 | 2 | 3 | 4 | findings |\n|---|---|---|---|---|---|---|---|---|---|\n"


def machine(name: str, folder: Path) -> Machine:
    if name != "mount":
        return machine_of(folder, name)
    (folder / "mount.yaml").write_text(MOUNT)
    return load_machine(folder / "mount.yaml")


def ran(case: Case, rounds: int) -> Answers:
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        made = machine(case.machine, folder)
        program = hostile_program(made, folder / "out", case.real, FLAGS, case.features or ALL)
        return answers(program, max(100, round(case.share * rounds)), *case.every)


def rows(case: Case, found: Answers) -> Iterator[str]:
    what = f"{case.real}, {case.features or 'everything'}"
    findings = (
        "none" if found.code == 0 else found.said.splitlines()[0] if found.said else f"exit code {found.code}"
    )
    for function, codes in found.counts.items():
        if sum(codes):
            told = " | ".join(f"{count:,}" for count in codes)
            yield f"| {case.what} | {what} | `{function}` | {sum(codes):,} | {told} | {findings} |\n"
    if not found.counts:
        yield f"| {case.what} | {what} | - | - | - | - | - | - | - | {findings} |\n"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=1_000_000)
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    since, found = time.monotonic(), [(case, ran(case, given.rounds)) for case in CASES]
    minutes = (time.monotonic() - since) / 60
    table = "".join(row for case, answer in found for row in rows(case, answer))
    given.output.write_text(
        _TEXT.format(rounds=given.rounds, minutes=minutes, head=_HEAD, table=table), encoding="utf-8"
    )
    return int(any(answer.code != 0 for _, answer in found))


_TEXT = """# Hostile input to the generated C

    python -m benchmarks.hostile_c --rounds {rounds} -o benchmarks/results/hostile_c.md

{minutes:.0f} minutes on one core of a busy machine, compiled with
`-O1 -fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all`. Joints, poses, guesses, parameters, drivers
and times are as they should be, or NaN, infinite, denormal, as large as numbers can be, far out of their range; poses are
out of reach, no rotations, reflections; p and z are often NULL. Outputs are blocks of exactly their size, or lie upon an input,
wholly or one number aside.

Codes: 0 solved, 1 not reachable, 2 iteration limit, 3 joint range, 4 bad input. A finding would be: a report of a sanitizer,
another code, an output that has changed on a code other than 0 (the struct of `state_update` and the count of `ik_all`
too), a solution that misses its pose or lies outside the joint ranges, a batch that says something else than its rows one by
one, another answer where the output lies upon an input. A search that finds nothing takes far longer than what is worked out
at once: of the code with everything `ik`, `compensate`, `ik_all`, `point` and batches are called in some of the rounds, and a
hexapod, whose forward kinematics is a search, has a hundredth of the rounds. Calls count these; checks call as many again.

{head}{table}"""

if __name__ == "__main__":
    raise SystemExit(main())
