"""Peers written in Python run in an interpreter that has them, which need not be this one: scripts in `peer_scripts`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .machine import pinned, run
from .outcome import Timing

SCRIPTS = Path(__file__).parent / "peer_scripts"
PACKAGES = ("pin", "roboticstoolbox-python", "ssik", "numba", "numpy")
_PROBE = """
import importlib.metadata as m, json, site, sys
found = {}
for name in sys.argv[1:]:
    try:
        found[name] = m.version(name)
    except m.PackageNotFoundError:
        pass
print(json.dumps([found, site.getsitepackages(), sys.version.split()[0]]))
"""


@dataclass(frozen=True)
class Peers:
    """An interpreter, its version, the versions of the peers it has, and where its packages are."""

    python: str
    version: str
    versions: dict[str, str]
    site_packages: tuple[Path, ...]

    def missing(self) -> list[str]:
        return [name for name in PACKAGES if name not in self.versions]


def peers_of(python: str) -> Peers:
    """What an interpreter has."""
    versions, places, version = json.loads(run([python, "-c", _PROBE, *PACKAGES]))
    return Peers(python, version, versions, tuple(Path(place) for place in places))


def timed(peers: Peers, script: str, inputs: dict[str, object], folder: Path, core: int | None) -> Timing:
    """Run a script on named arrays and numbers; it writes ``seconds``, one a repeat, and ``output``."""
    given, taken = folder / f"{script}_in.npz", folder / f"{script}_out.npz"
    arrays: dict[str, Any] = {key: np.asarray(value) for key, value in inputs.items()}
    np.savez(given, **arrays)
    pinned([peers.python, SCRIPTS / f"{script}.py", given, taken], core)
    with np.load(taken) as results:
        return Timing(float(np.median(results["seconds"])), results["output"])
