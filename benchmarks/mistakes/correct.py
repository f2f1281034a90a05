"""Pairs with no mistake: real recordings, bundled machines, practice and challenge cases, this benchmark's sources."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import truepose

from .pairs import MACHINE, copied, write
from .sources.rota import MOST, turns

CORRECT = "correct"
BESIDE = Path(__file__).resolve().parents[3] / "shared"
DATA, PRACTICE = BESIDE / "data", BESIDE / "practice"
"""Real recordings and practice cases, where they are; what is not there is left out."""
EXAMINED = 6
"""Every sixth pair beyond the fixed ones is a case of the challenge, its strata in turn."""
FIXED = 0.35
"""Share of real, bundled and practice pairs, at most: a small set takes some of them."""
Writer = Callable[[Path], None]


def correct_case(folder: Path, seed: int, k: int, total: int) -> str:
    """Write the k-th right pair of ``total``; where it came from."""
    fixed = real() | bundled() | practice()
    names = list(fixed)
    some = names if len(names) < FIXED * total else _some(names, int(FIXED * total), seed)
    if k < len(some):
        fixed[some[k]](folder)
        return some[k]
    if k % EXAMINED == 0 and _challenge(folder, seed, k):
        return "challenge"
    return _simulated(folder, seed, k)


def _some(names: list[str], count: int, seed: int) -> list[str]:
    order = np.random.default_rng([seed, 3]).permutation(len(names))
    return [names[int(j)] for j in order[:count]]


def real() -> dict[str, Writer]:
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
    _beside()
    from real_recordings.panda import panda_files

    folder.mkdir(parents=True)
    machine, _ = panda_files(DATA, folder, sets)
    machine.rename(folder / MACHINE)


def _mount(folder: Path) -> None:
    """As ``truepose import --machine`` has it."""
    from truepose.identification.recording.importing import frame_of, machine_of, read_foreign

    stars = DATA / "telescope-mount" / "gem-28.dat"
    folder.mkdir(parents=True)
    (folder / MACHINE).write_text(machine_of(stars), encoding="utf-8")
    frame_of(read_foreign(stars)).to_csv(folder / "recording.csv", index=False)


def _beside() -> None:
    """The other benchmarks import each other from their folder."""
    home = str(Path(__file__).resolve().parents[1])
    if home not in sys.path:
        sys.path.insert(0, home)


def bundled() -> dict[str, Writer]:
    """Machines that come with truepose, with each of their recordings."""
    out: dict[str, Writer] = {}
    home = Path(truepose.__file__).parent / "models" / "machines"
    for machine in sorted(home.glob(f"*/{MACHINE}")):
        for path in sorted(machine.parent.glob("*.csv")):
            name = f"bundled {machine.parent.name} {path.stem}"
            out[name] = partial(copied, machine=machine, recordings=[path])
    return out


def practice() -> dict[str, Writer]:
    """Cases of another simulator."""
    out: dict[str, Writer] = {}
    for case in sorted(PRACTICE.glob("case*")):
        for machine in sorted(case.glob("machine*.yaml")):
            name = f"practice {case.name} {machine.stem}"
            out[name] = partial(copied, machine=machine, recordings=[case / "recording.csv"])
    return out


def _challenge(folder: Path, seed: int, k: int) -> bool:
    """A case as the examination of diagnoses draws it; False where this seat had nothing to offer."""
    from challenge.cases import draw_case
    from challenge.schedule import schedule
    from challenge.simulator.registry import MACHINES
    from challenge.strata import UndrawnError

    place = k // EXAMINED
    seat = schedule(place + 1, tuple(MACHINES))[place]
    try:
        case = draw_case(MACHINES[seat.machine](), replace(seat, index=k + 1), seed)
    except UndrawnError:
        return False
    folder.mkdir(parents=True)
    (folder / MACHINE).write_text(case.machine, encoding="utf-8")
    (folder / "recording.csv").write_text(case.recording, encoding="utf-8")
    return True


def _simulated(folder: Path, seed: int, k: int) -> str:
    """The sources in turn; some arms with base and tool told as unknown."""
    turn = turns(np.random.default_rng([seed, 13]))
    for attempt in range(20):
        rng = np.random.default_rng([seed, 5, k, attempt])
        source = turn(k + attempt)
        try:
            pair = source.make(rng, effects=int(rng.integers(0, MOST + 1)), unknown=bool(rng.random() < 0.25))
        except ValueError:
            continue
        write(folder, pair.document, pair.table, pair.files)
        return pair.source
    raise LookupError(f"right pair {k}: nothing could be measured")


__all__ = ["CORRECT", "bundled", "correct_case", "practice", "real"]
