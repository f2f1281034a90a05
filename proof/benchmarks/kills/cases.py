"""Commands that write, each with the words of an old and of a new result, and which files of it belong together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

Seen = Mapping[str, bytes]
"""What can be read of a result, by name."""
WORKING = ("journal.jsonl",)
"""What is no result: the notes of a fleet's run that goes on."""


@dataclass(frozen=True)
class Case:
    """A command; ``{n}`` in its words stands for 1 in the old and 2 in the new result. No ``before``: there is no old one.

    run: what is done in its place, a control of the study.
    """

    name: str
    words: str
    before: bool = True
    code: int = 0
    run: Callable[[list[str]], object] | None = None

    def arguments(self, n: int) -> list[str]:
        """Words of the first or second result."""
        return self.words.format(n=n).split()


CASES = (
    Case("init", "init --arm ur5e -o out/cell.yaml --force", before=False),
    Case("check --fix", "check in/machine.yaml in/metres{n}.csv --fix out", code=2),
    Case("calibrate", "calibrate in/machine.yaml in/rows{n}a.csv -o out"),
    Case("diagnose", "diagnose in/machine.yaml in/rows{n}a.csv -o out"),
    Case("identifiability", "identifiability in/machine.yaml in/rows{n}a.csv -o out"),
    Case("drift", "drift in/machine.yaml in/rows{n}a.csv in/rows{n}b.csv -o out"),
    Case("plan", "plan in/machine.yaml -n 5 --method exchange --seed {n} -o out/poses.csv"),
    Case("poses", "poses in/seen{n}.csv --sigma 0.005 -o out/poses.csv"),
    Case("predict", "predict in/machine.yaml in/rows{n}a.csv -o out/rows.parquet"),
    Case("simulate", "simulate in/machine.yaml in/poses{n}.csv -o out/rows.csv"),
    Case("compensate", "compensate in/machine.yaml in/poses{n}.csv -o out/commands.csv --anyway"),
    Case(
        "compensate a program",
        "compensate in/robot.yaml in/job{n}.src -o out/job.src --anyway --base 800,0,400,0,0,0",
    ),
    Case("codegen", "codegen in/machine{n}.yaml -o out --anyway"),
    Case("export", "export in/machine{n}.yaml -o out/arm.urdf"),
    Case("import", "import in/points{n}.txt --joints in/joints.csv -o out/rows.csv"),
    Case("schema", "schema machine -o out/schema.json", before=False),
    Case("demo", "demo mount -o out", before=False),
    Case("fleet", "fleet in/line{n} -o out --workers 1 --brief"),
)


def seen(folder: Path) -> dict[str, bytes]:
    """What a reader finds in a folder of results: no hidden names, links followed."""
    out = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        hidden = any(part.startswith(".") for part in name.parts)
        if not hidden and path.is_file() and name.name not in WORKING:
            out[name.as_posix()] = path.read_bytes()
    return out


def state(found: Seen, old: Seen, new: Seen) -> str:
    """``old``, ``new`` or ``mixed``. Machines of a fleet are results of their own, and may be there or not, but whole."""
    if dict(found) == dict(old):
        return "old"
    if dict(found) == dict(new):
        return "new"
    parts = {name: _part(name) for name in {**found, **old, **new}}
    if len(set(parts.values())) < 2:
        return "mixed"
    states = {part: _state_of(part, parts, found, old, new) for part in set(parts.values())}
    return "mixed" if "mixed" in states.values() else states.get("", "old")


def _part(name: str) -> str:
    """The machine of a fleet whose result a file is; empty for all else."""
    first, _, rest = name.partition("/")
    return f"{first}/{rest.partition('/')[0]}" if first == "machines" else ""


def _state_of(part: str, parts: Mapping[str, str], found: Seen, old: Seen, new: Seen) -> str:
    mine, before, after = (
        {name: data for name, data in one.items() if parts[name] == part} for one in (found, old, new)
    )
    if mine == before or (part and not mine):
        return "old"
    return "new" if mine == after else "mixed"


__all__ = ["CASES", "Case", "Seen", "seen", "state"]
