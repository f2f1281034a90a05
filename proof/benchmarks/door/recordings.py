"""Right pairs that are not drawn: recordings of others and their halves, bundled machines, practice cases."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pandas as pd

import truepose

from .outcome import REAL
from .pairs import MACHINE, copied, found

BESIDE = Path(__file__).resolve().parents[4] / "shared"
DATA, PRACTICE = BESIDE / "data", BESIDE / "practice"
"""Real recordings and practice cases, where they are; what is not there is left out."""
Writer = Callable[[Path], None]
HALVES: dict[str, slice] = {"odd": slice(0, None, 2), "even": slice(1, None, 2)}
"""Halves that any recording has; those in time are its first and second."""


def recordings() -> dict[str, tuple[str, Writer]]:
    """Return kind and writer of every pair by name; those that are not on this machine are left out."""
    out: dict[str, tuple[str, Writer]] = {}
    for name, writer in _real().items():
        out[name] = REAL, writer
        for half in ("first", "second", *HALVES):
            out[f"{name} {half} half"] = f"{REAL}, halves", partial(_half, writer=writer, half=half)
    out |= {name: ("bundled machines", writer) for name, writer in _bundled().items()}
    return out | {name: ("practice cases", writer) for name, writer in _practice().items()}


def _real() -> dict[str, Writer]:
    """Recordings that others measured, each file by itself."""
    out: dict[str, Writer] = {}
    for folder, names in (
        ("ur10-laser-tracker", ("configurations", "random", "grid")),
        ("stewart-mocap", None),
    ):
        home = DATA / folder
        if not (home / MACHINE).is_file():
            continue
        for path in sorted(home.glob("*.csv")):
            if names is None or path.stem in names:
                out[f"real {folder} {path.stem}"] = partial(copied, machine=home / MACHINE, recordings=[path])
    if (DATA / "panda-ball-socket").is_dir():
        for sets in (("panda_1",), ("panda_1_with_sensor",), ("panda_1", "panda_1_with_sensor")):
            out[f"real panda {'+'.join(sets)}"] = partial(_panda, sets=sets)
    if (DATA / "telescope-mount").is_dir():
        out["real mount"] = _mount
    return out


def _panda(folder: Path, sets: tuple[str, ...]) -> None:
    from real_recordings.panda import panda_files

    folder.mkdir(parents=True)
    machine, _ = panda_files(DATA, folder, sets)
    machine.rename(folder / MACHINE)


def _mount(folder: Path) -> None:
    """As ``truepose import --machine`` has it."""
    from truepose.identification.leaves.readers.importing import frame_of, machine_of, read_foreign

    stars = DATA / "telescope-mount" / "gem-28.dat"
    folder.mkdir(parents=True)
    (folder / MACHINE).write_text(machine_of(stars), encoding="utf-8")
    frame_of(read_foreign(stars)).to_csv(folder / "recording.csv", index=False)


def _bundled() -> dict[str, Writer]:
    """Machines that come with truepose, with each of their recordings."""
    out: dict[str, Writer] = {}
    home = Path(truepose.__file__).parent / "models" / "machines"
    for machine in sorted(home.glob(f"*/{MACHINE}")):
        for path in sorted(machine.parent.glob("*.csv")):
            name = f"bundled {machine.parent.name} {path.stem}"
            out[name] = partial(copied, machine=machine, recordings=[path])
    return out


def _practice() -> dict[str, Writer]:
    """Cases of another simulator."""
    out: dict[str, Writer] = {}
    for case in sorted(PRACTICE.glob("case*")):
        for machine in sorted(case.glob("machine*.yaml")):
            name = f"practice {case.name} {machine.stem}"
            out[name] = partial(copied, machine=machine, recordings=[case / "recording.csv"])
    return out


def _half(folder: Path, writer: Writer, half: str) -> None:
    """Write one half of a pair's rows."""
    writer(folder)
    for path in found(folder)[1]:
        table = pd.read_csv(path, comment="#")
        middle = len(table) // 2
        own = HALVES.get(half, slice(0, middle) if half == "first" else slice(middle, None))
        table.iloc[own].to_csv(path, index=False)


__all__ = ["recordings"]
