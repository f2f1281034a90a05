"""What of the 150 source errors the three targets can tell: ranks by tolerance, both ways of section 4.1, Table 2."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.identification.identifiability.observability import Columns, Subset

from . import regression
from . import workspace as ws
from .irreducible import sequential_subset, spectral_reduction
from .regression import Array, Nodes
from .source_errors import MIDDLE, SourceError, frames, source_error_machine, source_errors

TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-12, 1e-14)
NEW = 1e-9
"""Share of a column that must be new in the sequential way: between the least seen direction and rounding."""
SEEN = 1e-12
"""Singular values above it, in parts of the largest, are not rounding."""
TURNED = {
    "exact translation": 0.0,
    "turned by 1e-6 rad": 1e-6,
    "turned by 1e-3 rad": 1e-3,
    "turned by 0.05 rad": 0.05,
}
"""1-sigma, rad, by which the tool's orientation scatters about the reference in each motion."""
NEARLY = "turned by 1e-3 rad"
_SAME = dict(zip("xyz", "xyz", strict=True))
_FIRST, _SECOND = dict(zip("xyz", "zyx", strict=True)), dict(zip("xyz", "xzy", strict=True))
PAPER_AXES: Mapping[tuple[bool, int], Mapping[str, str]] = {
    **{
        (True, link): axes
        for link, axes in enumerate((_SAME, _FIRST, _SECOND, dict(zip("xyz", "yxz", strict=True))))
    },
    (True, 4): _FIRST,
    (True, 5): _SECOND,
    (True, 6): _SAME,
    **{(False, link): axes for link, axes in enumerate((_SAME, _FIRST, _SECOND, _SAME, _SAME))},
    (False, 5): dict(zip("xyz", "zxy", strict=True)),
    (False, 6): dict(zip("xyz", "yzx", strict=True)),
}
"""Axes of the graph, signs aside, for the paper's x, y, z of link j: z along joint j, x normal to joints j and j + 1.
Keys: whether it is one of limbs 1 to 3, and j."""
_ANGLES = {"alpha": "x", "beta": "y", "gamma": "z"}
_ALL = ("x", "y", "z", "alpha", "beta", "gamma")
TABLE_2: Mapping[tuple[int, int], Sequence[str]] = {
    **{(limb, 0): ("x", "y", "z") for limb in (1, 2, 3)},
    **{(limb, 2): ("x", "z") for limb in (1, 2, 3)},
    **{(limb, 3): ("z", "alpha") for limb in (1, 2, 3)},
    **{(limb, 6): ("x", "z") for limb in (2, 3)},
    (4, 0): _ALL,
    (4, 2): ("x", "z", "alpha"),
    (4, 3): ("x", "z", "alpha", "beta"),
    (4, 4): _ALL[:5],
    (4, 5): ("x", "z", "alpha"),
    (4, 6): ("y", "alpha"),
}
"""The paper's irreducible set, by (limb, link), without the six encoders; link 4 of limb 4 as in Tables 3 and 4."""


def poses(turned: float) -> Array:
    """(98, 4, 4) tool frames at 7 x 7 nodes of the lower and upper layers, orientations scattered by ``turned`` rad."""
    at = ws.layers(7, "lower", "upper")
    turns = Rotation.from_rotvec(turned * np.random.default_rng(4).normal(size=(len(at), 3))).as_matrix()
    return ws.tool_poses(at, turns)


@cache
def nodes(turned: float) -> Nodes:
    """The nominal model there."""
    return regression.at(ws.joints(poses(turned)))


def singular_values(turned: float, angle: str = "deg") -> Array:
    """(150,) of H, columns per mm and per deg or rad."""
    return np.asarray(np.linalg.svd(nodes(turned).H * regression.unit(angle), compute_uv=False))


def rank_rows(angle: str = "deg") -> list[list[str]]:
    """For each motion the rank of H at each relative tolerance."""
    rows = []
    for name, turned in TURNED.items():
        s = singular_values(turned, angle)
        rows.append([name, *(str(int(np.sum(s > tolerance * s[0]))) for tolerance in TOLERANCES)])
    return rows


def columns(turned: float) -> Columns:
    """H of a motion as the library takes it, per mm and deg."""
    names = tuple(error.parameter for error in regression.errors())
    return Columns(names, nodes(turned).H * regression.unit(), regression.unit())


@cache
def sequential(turned: float = TURNED[NEARLY]) -> Subset:
    """The second way of section 4.1: encoders first, then the limbs in order."""
    return sequential_subset(columns(turned), tolerance=NEW)


@cache
def kept(turned: float = TURNED[NEARLY]) -> tuple[int, ...]:
    """Places among the source errors of the sequential set, in order."""
    names = set(sequential(turned).kept)
    return tuple(k for k, error in enumerate(regression.errors()) if error.parameter in names)


def spectral_rank(turned: float) -> int:
    """The first way: eigenvectors of H'H whose eigenvalues are not zero."""
    return len(spectral_reduction(columns(turned)).eigenvalues)


def chosen() -> tuple[SourceError, ...]:
    """The 54 source errors of the sequential set."""
    return tuple(regression.errors()[k] for k in kept())


def comparison_rows() -> list[list[str]]:
    """Errors of each link kept by the sequential way against Table 2: ours, then the paper's."""
    rows = []
    for limb in (1, 2, 3, MIDDLE):
        for link in range(7):
            own = [e for e in chosen() if (e.limb, e.link) == (limb, link) and e.component != "offset"]
            ours = ", ".join(f"{e.parameter}" for e in own)
            theirs = ", ".join(TABLE_2.get((limb, link), ()))
            if ours or theirs:
                rows.append([str(limb), str(link), ours or "-", theirs or "-"])
    return rows


@dataclass(frozen=True)
class TableTwo:
    """Table 2's columns by the definitions of appendix A: how many, of which rank, without effect, and left out."""

    count: int
    rank: int
    silent: tuple[str, ...]
    excluded: tuple[str, ...]


def table_two() -> TableTwo:
    """What Table 2's set would be worth. ``excluded``: errors along or about a joint's own axis."""
    ours = {error.parameter for error in regression.errors()}
    named = list(_table_two_parameters())
    parameters = [e.parameter for e in regression.errors()[: regression.ENCODERS]] + [p for _, p in named]
    turned = nodes(TURNED[NEARLY])
    h = regression.at(turned.q, parameters).H
    sizes = np.linalg.norm(h, axis=0)
    silent = [
        label for (label, _), size in zip(named, sizes[regression.ENCODERS :], strict=True) if size < 1e-9
    ]
    s = np.linalg.svd(h / np.where(sizes > 1e-9, sizes, 1.0), compute_uv=False)
    rank = int(np.sum(s > NEW * s[0]))
    return TableTwo(len(parameters), rank, tuple(silent), tuple(label for label, p in named if p not in ours))


def _table_two_parameters() -> Iterator[tuple[str, str]]:
    for (limb, link), components in TABLE_2.items():
        axes = PAPER_AXES[limb != MIDDLE, link]
        for component in components:
            axis = axes[_ANGLES.get(component, component)]
            turn = "r" if component in _ANGLES else ""
            yield f"{component}_{link},{limb}", f"{frames(limb)[link]}.{turn}{axis}"


def ball_rows() -> list[list[str]]:
    """Ranks with other orders of the three axes inside the spherical joints: x radial, z along the limb at home."""
    rows = []
    for order in ("xyz", "yxz", "zxy", "zyx"):
        one, names = source_error_machine(ball=order), [e.parameter for e in source_errors(order)]
        cells = []
        for turned in (0.0, TURNED[NEARLY]):
            s = np.linalg.svd(regression.at(nodes(turned).q, names, one).H * _units(order), compute_uv=False)
            cells.append(str(int(np.sum(s > SEEN * s[0]))))
        rows.append([order, *cells])
    return rows


def _units(order: str) -> Array:
    return np.array([np.radians(1.0) if error.turns else 1.0 for error in source_errors(order)])


def without_one_link() -> dict[tuple[int, int], int]:
    """Rank of H when the five errors of one link are not counted, by (limb, link): 145 errors each time."""
    h = nodes(TURNED[NEARLY]).H * regression.unit()
    out = {}
    for limb in (1, 2, 3, MIDDLE):
        for link in range(1, 7):
            left = [
                k
                for k, e in enumerate(regression.errors())
                if (e.limb, e.link) != (limb, link) or e.component == "offset"
            ]
            s = np.linalg.svd(h[:, left], compute_uv=False)
            out[limb, link] = int(np.sum(s > SEEN * s[0]))
    return out
