"""pinocchio's C++ library as a peer: Newton's method, compiled from the headers of the `pin` wheel or of a package."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .arms import Arm
from .forward import placements
from .machine import pinned, run, tool
from .outcome import Timing, median_of
from .peers import Peers
from .problems import ProblemFiles

DRIVER = Path(__file__).parent / "drivers" / "pinocchio.cpp"
MODES = {
    "clik": "documented loop (CLIK), full step",
    "lean": "one pass, LU, Jlog6",
    "leaner": "one pass, LU",
    "restarts": "one pass, LU, Jlog6, restarts",
    "ranges": "one pass, LU, Jlog6, restarts until in the ranges",
}
_DEFINES = ("-DNDEBUG", "-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS")


@dataclass(frozen=True)
class Newton:
    """The compiled program."""

    path: Path
    flags: tuple[str, ...]


def headers(peers: Peers, given: Sequence[Path] = ()) -> list[Path] | str:
    """Folders with pinocchio's, Boost's and Eigen's headers, or what is missing.

    Looked for in ``given``, in the wheels of the peers' interpreter and in /usr/include.
    """
    if tool("g++") is None:
        return "no g++"
    roots = [*given, *(path / "cmeel.prefix" / "include" for path in peers.site_packages)]
    roots += [Path("/opt/openrobots/include"), Path("/usr/include")]
    found = []
    for needed in ("pinocchio/algorithm/jacobian.hpp", "boost/variant.hpp", "Eigen/Core"):
        places = [root for base in roots for root in (base, base / "eigen3") if (root / needed).exists()]
        if not places:
            return f"no header {needed}"
        found.append(places[0])
    return list(dict.fromkeys(found))


def build(include: Sequence[Path], folder: Path, flags: Sequence[str], compiler: str = "g++") -> Newton:
    """Compile the program from headers alone, so that every template gets ``flags``: half a minute, once a folder."""
    path = folder / ("pinocchio" + "".join(flags).replace("=", "-"))
    if path.exists() and path.stat().st_mtime > DRIVER.stat().st_mtime:
        return Newton(path, tuple(flags))
    places = [
        word for folder_ in include if folder_ != Path("/usr/include") for word in ("-isystem", str(folder_))
    ]
    run([compiler, "-std=c++17", *flags, *_DEFINES, *places, str(DRIVER), "-o", str(path)])
    return Newton(path, tuple(flags))


def chain(arm: Arm, folder: Path) -> Path:
    """The placements of an arm in metres and its ranges, as the program reads them."""
    path = folder / f"{arm.name}_chain.bin"
    rows = placements(arm)[:, :3].copy()
    rows[:, :, 3] *= 1e-3
    np.concatenate([rows.ravel(), arm.ranges.T.ravel()]).tofile(path)
    return path


def timed(
    program: Newton, mode: str, arm: Path, files: ProblemFiles, repeats: int, core: int | None
) -> Timing:
    """Time a mode of ``MODES`` on the chain file ``arm``; rows of 1 or 0 and six joints."""
    out = program.path.with_suffix(".out")
    words: list[str | Path] = [program.path, mode, arm, files.metres, files.guesses, out, str(repeats)]
    seconds = median_of(pinned(words, core))
    return Timing(seconds, np.fromfile(out).reshape(-1, 7))
