"""Times the generated inverse kinematics and its peers in one run and prints the tables as Markdown."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from truepose.files import atomic_write_text

from . import arms, branches, evaluations, hexapod, instructions, machine, newton, peers, study, tables
from .outcome import Row, quietest

Part = Callable[[study.Bench, study.Options], str]


def _timings(measure: Callable[[study.Bench, study.Options], list[Row]]) -> Part:
    return lambda b, options: tables.timings(quietest(lambda: measure(b, options), options.rounds))


def _instructions(b: study.Bench, options: study.Options) -> str:
    return (
        tables.counts(instructions.rows(b, options))
        if machine.tool("valgrind")
        else "No valgrind: not counted."
    )


def _evaluations(b: study.Bench, options: study.Options) -> str:
    return f"At most {evaluations.most(b, options)} evaluations of the model in the generated C's inverse."


PARTS: dict[str, tuple[str, Part]] = {
    "warm": ("guess 1 deg away in every joint", _timings(study.warm)),
    "instructions": ("the same, instructions", _instructions),
    "python": ("the same from Python, one call a pose", _timings(study.python)),
    "random": ("solution and guess anywhere in the ranges", _timings(study.random)),
    "evaluations": ("the same, evaluations of the worst pose", _evaluations),
    "branches": ("all branches of a pose", _timings(branches.rows)),
}
HEXAPOD = "hexapod"
GENERAL = "general"


def main(arguments: list[str] | None = None) -> int:
    """Write the arms, generate and compile, measure, print; with -o also into a file."""
    given = _parser().parse_args(arguments)
    lines = []
    with tempfile.TemporaryDirectory() as scratch:
        options = _options(given, Path(given.work or scratch))
        for text in _report(given, options):
            sys.stdout.write(text + "\n\n")
            sys.stdout.flush()
            lines.append(text)
    if given.o:
        atomic_write_text(given.o, "\n\n".join(lines) + "\n")
    return 0


def _report(given: argparse.Namespace, options: study.Options) -> Iterator[str]:
    yield _setting(options)
    if set(given.part) & set(PARTS):
        programs = study.newton_programs(options)
        for name in given.arm:
            b = study.bench(arms.DRAWINGS[name], options, programs)
            for missing in b.source.missing():
                yield f"{b.arm.title}: {missing}"
            for part, (title, measure) in PARTS.items():
                if part in given.part:
                    yield f"## {b.arm.title}: {title}\n\n{measure(b, options)}"
    for drawing in arms.GENERAL.values() if GENERAL in given.part else ():
        b = study.bench(drawing, options, {})
        yield f"## {b.arm.title}: all branches of a pose\n\n{_timings(branches.rows)(b, options)}"
    if HEXAPOD in given.part:
        rows = quietest(lambda: hexapod.rows(options), options.rounds)
        yield f"## 6-PUS: inverse\n\n{tables.timings(rows)}"


def _setting(options: study.Options) -> str:
    command = "python -m benchmarks.inverse_kinematics " + " ".join(sys.argv[1:])
    versions = ", ".join(f"{name} {version}" for name, version in options.peers.versions.items())
    missing = [*options.peers.missing(), *([options.include] if isinstance(options.include, str) else [])]
    close = "1e-9 m and 1e-9 rad"
    if options.real == "float":
        close += ", the C in float within 2e-6 of the reach and 2e-6 rad,"
    items = [
        f"`{command.strip()}`",
        f"{machine.processor()}; core {options.core}; {machine.compiler_version('gcc')}",
        f"Python {options.peers.version}: {versions}"
        + (f"; missing: {', '.join(missing)}" if missing else ""),
        f"real: {options.real}; {options.warm} near and {options.poses} random poses, seeds fixed",
        f"processor time: median of {options.repeats} repeats (random 3, branches 1 to 3), the smallest of "
        f"{options.rounds} rounds",
        f"solved: within {close} by a forward model that shares nothing with truepose",
    ]
    return "# Inverse kinematics beside peers\n\n" + "\n".join(f"* {item}" for item in items)


def _options(given: argparse.Namespace, folder: Path) -> study.Options:
    folder.mkdir(parents=True, exist_ok=True)
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    core = given.core if given.core is not None else (cores[-1] if cores else None)
    if core is not None and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {core})
    found = peers.peers_of(given.peers)
    return study.Options(
        poses=given.poses,
        warm=given.warm,
        branches=given.branches,
        repeats=given.repeats,
        rounds=given.rounds,
        real=given.real,
        core=core,
        folder=folder,
        peers=found,
        include=newton.headers(found, given.include),
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.inverse_kinematics", description=__doc__)
    parser.add_argument("--poses", type=int, default=100_000, help="random poses (default 100000)")
    parser.add_argument("--warm", type=int, default=10_000, help="poses with a guess nearby (default 10000)")
    parser.add_argument(
        "--branches", type=int, default=2_000, help="poses of which all branches are found (default 2000)"
    )
    parser.add_argument("--repeats", type=int, default=11, help="repeats of what is quick (default 11)")
    parser.add_argument(
        "--rounds", type=int, default=1, help="rounds, of which the quietest counts (default 1)"
    )
    parser.add_argument("--real", choices=("double", "float"), default="double", help="type of the C")
    parser.add_argument("--arm", nargs="+", choices=sorted(arms.DRAWINGS), default=list(arms.DRAWINGS))
    parser.add_argument(
        "--part", nargs="+", choices=[*PARTS, GENERAL, HEXAPOD], default=[*PARTS, GENERAL, HEXAPOD]
    )
    parser.add_argument(
        "--peers", default=sys.executable, metavar="PYTHON", help="interpreter that has the peers"
    )
    parser.add_argument(
        "--include", type=Path, nargs="*", default=[], metavar="DIR", help="folders with C++ headers of peers"
    )
    parser.add_argument("--core", type=int, help="processor core to run on (default: the last)")
    parser.add_argument("--work", type=Path, metavar="DIR", help="keep generated and compiled files there")
    parser.add_argument("-o", type=Path, metavar="FILE", help="write the tables there too")
    return parser


if __name__ == "__main__":
    sys.exit(main())
