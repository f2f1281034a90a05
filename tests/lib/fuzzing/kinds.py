"""Good files of every kind that is read, which mutants are made from, and the commands that read them."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from fuzzing import seeds
from truepose.models.file.yaml_document import document_text


@dataclass(frozen=True)
class Seed:
    """A good file, by the name that the mutant has, what stands beside it, and the commands of which one is run."""

    file: str
    data: bytes
    commands: Sequence[Sequence[str]]
    beside: dict[str, bytes] = field(default_factory=dict)

    def laid_out(self, folder: Path, data: bytes) -> None:
        """Write the mutant and what stands beside it."""
        for old in folder.iterdir():
            shutil.rmtree(old) if old.is_dir() else old.unlink()
        for name, text in {**self.beside, self.file: data}.items():
            (folder / name).write_bytes(text)


M, R = "machine.yaml", "recording.csv"
ON_MACHINES = (
    ("calibrate", M, R, "-o", "out/fit"),
    ("check", M, R),
    ("simulate", M, R, "-o", "out/seen.csv"),
    ("predict", M, R, "-o", "out/said.csv"),
    ("identifiability", M, R),
    ("compensate", M, R, "-o", "out/commands.csv", "--anyway"),
    ("codegen", M, "-o", "out/c"),
    ("plan", M, "-n", "4", "-o", "out/poses.csv"),
    ("export", M, "-o", "out/arm.urdf"),
    ("drift", M, R, R),
)
ON_RECORDINGS = ON_MACHINES[:6]
INIT = ("init", "--urdf", "arm.urdf", "-o", "out/arm.yaml")


def _machines(folder: Path) -> list[Seed]:
    return [Seed(M, c.machine.encode(), ON_MACHINES, {R: c.recording.encode()}) for c in seeds.cases(folder)]


def _recordings(folder: Path) -> list[Seed]:
    return [
        Seed(R, c.recording.encode(), ON_RECORDINGS, {M: c.machine.encode()}) for c in seeds.cases(folder)
    ]


def _urdf(folder: Path) -> list[Seed]:
    machine, rows = seeds.URDF_MACHINE.encode(), b"pan,lift\n10,20\n-30,5\n40,60\n"
    commands = (
        INIT,
        (*INIT, "--tip-link", "jaw"),
        (*INIT, "--expand", "--base-link", "world", "--tip-link", "tip"),
        (*INIT, "--tip-link", "tip,jaw,thumb"),
        ("simulate", M, R, "-o", "out/seen.csv"),
        ("codegen", M, "-o", "out/c"),
    )
    return [Seed("arm.urdf", seeds.URDF.encode(), commands, {M: machine, R: rows})]


def _mjcf(folder: Path) -> list[Seed]:
    one = (("init", "--mjcf", "arm.xml", "-o", "out/arm.yaml"),)
    several = (("init", "--mjcf", "arm.xml", "--tip", "pen", "-o", "out/arm.yaml"),)
    return [Seed("arm.xml", seeds.MJCF.encode(), one), Seed("arm.xml", seeds.LOOPED_MJCF.encode(), several)]


def _bags(folder: Path) -> list[Seed]:
    from support.guide_bag import write_bag

    bag = write_bag(folder, poses=3, samples=14).read_bytes()
    machine = (folder / "as_built.yaml").read_bytes()
    commands = (
        ("import", "run.mcap", "-o", "out/rows.csv"),
        ("import", "run.mcap", "--topic", "/tracker/pose", "-o", "out/rows.csv"),
        ("check", M, "run.mcap"),
    )
    return [Seed("run.mcap", bag, commands, {M: machine})]


def _sqlite_bags(folder: Path) -> list[Seed]:
    from support.guide_bag import write_bag

    bag = write_bag(folder, poses=3, samples=14, storage="SQLITE3").read_bytes()
    commands = (("import", "run.db3", "-o", "out/rows.csv"),)
    return [Seed("run.db3", bag, commands)]


def _ros1_bags(folder: Path) -> list[Seed]:
    from support.guide_bag import write_bag
    from support.ros1_bag import as_ros1

    bag = write_bag(folder, poses=3, samples=14)
    made = [as_ros1(bag, folder / f"{way}.bag", way).read_bytes() for way in ("none", "lz4", "bz2")]
    commands = (("import", "run.bag", "-o", "out/rows.csv"),)
    return [Seed("run.bag", data, commands) for data in made]


def _workbooks(folder: Path) -> list[Seed]:
    from support.workbook import write_workbook

    out = []
    for case in seeds.cases(folder):
        rows = [line.split(",") for line in case.recording.splitlines()]
        if case.name in ("full", "distance"):
            path = folder / "recording.xlsx"
            write_workbook(path, {"data": [rows[0], *([_cell(text) for text in row] for row in rows[1:])]})
            commands = (("check", M, "recording.xlsx"), ("import", "recording.xlsx", "-o", "out/rows.csv"))
            out.append(Seed("recording.xlsx", path.read_bytes(), commands, {M: case.machine.encode()}))
    return out


def _cell(text: str) -> object:
    try:
        return float(text)
    except ValueError:
        return text or None


def _probe_logs(folder: Path) -> list[Seed]:
    ways = [(t / 20, (t * 37 % 200) / 4, (t * t * 11 % 160) / 4 - 20) for t in range(120)]
    log = "time [s],a [deg],b [deg]\n" + "".join(f"{t},{a},{b}\n" for t, a, b in ways)
    probe = "time [s],x [mm],y [mm],z [mm]\n" + "".join(f"{t - 3},{a},{b},{a - b}\n" for t, a, b in ways)
    commands = (
        ("import", "probe.csv", "--log", "log.csv", "-o", "out/rows.csv"),
        ("import", "probe.csv", "--log", "log.csv", "--offset", "3", "-o", "out/rows.csv"),
        ("import", "log.csv", "--log", "probe.csv", "--offset", "-3", "-o", "out/rows.csv"),
    )
    files = {"probe.csv": probe.encode(), "log.csv": log.encode()}
    return [Seed(name, data, commands, files) for name, data in files.items()]


def _points(folder: Path) -> list[Seed]:
    commands = (
        ("import", "points.txt", "--joints", "joints.csv", "-o", "out/rows.csv"),
        ("import", "points.txt", "-o", "out/rows.csv", "--machine", "out/mount.yaml"),
        ("import", "points.txt", "-o", "out/rows.csv"),
    )
    return [
        Seed("points.txt", text.encode(), commands, {"joints.csv": seeds.JOINTS.encode()})
        for text in seeds.POINTS
    ]


def _plugins(folder: Path) -> list[Seed]:
    (case,) = (case for case in seeds.cases(folder) if case.name == "full")
    effect = "stretched-belt@q1:k=0.01"
    commands = (
        ("simulate", M, R, "-o", "out/seen.csv", "--effect", effect, "--plugin", "belt.py"),
        ("codegen", "belt.yaml", "-o", "out/c", "--plugin", "belt.py"),
        ("calibrate", "belt.yaml", R, "-o", "out/fit", "--plugin", "belt.py", "--anyway"),
        ("effects", "stretched-belt", "--plugin", "belt.py"),
    )
    document = yaml.safe_load(case.machine)
    size = {"k": {"value": 0.01, "unit": "1/rad^2"}}
    entry = {"effect": "stretched-belt", "place": ["q1"], "parameters": size}
    own = document_text({**document, "effects": [entry]})
    beside = {M: case.machine.encode(), R: case.recording.encode(), "belt.yaml": own.encode()}
    return [Seed("belt.py", seeds.PLUGIN.encode(), commands, beside)]


def _programs(folder: Path) -> list[Seed]:
    from support.program_robots import arms, machine_file

    machine = machine_file(folder, arms()[1]).read_bytes()
    texts, out = (seeds.KRL, seeds.RAPID, seeds.URSCRIPT, seeds.TABLE), []
    files = dict(zip(("job.src", "job.mod", "job.script", "job.csv"), texts, strict=True))
    for name, text in files.items():
        way = ("--dialect", "csv") if name.endswith(".csv") else ()
        command = ("compensate", M, name, "-o", f"out/{name}", "--anyway", *way)
        out.append(Seed(name, text.encode(), (command,), {M: machine}))
    return out


KINDS: Mapping[str, Callable[[Path], list[Seed]]] = {
    "machine files": _machines,
    "recordings": _recordings,
    "URDF": _urdf,
    "MJCF": _mjcf,
    "MCAP": _bags,
    "sqlite bags": _sqlite_bags,
    "ROS 1 bags": _ros1_bags,
    "workbooks": _workbooks,
    "probe logs": _probe_logs,
    "points and stars": _points,
    "plug-ins": _plugins,
    "robot programs": _programs,
}
"""Makers of good files, by what these are."""
