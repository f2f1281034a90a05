"""Who imports whom, read from the code: the floors of the house, checked and drawn as ``figures/imports.svg``.

Every import counts, also one inside a function or under ``TYPE_CHECKING``. A module may import from its own
room and from rooms on lower floors.

    python docs/import_picture.py
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

ROOT = Path(__file__).resolve().parent.parent
BACK = "#c2452d"  # the colour of an import that runs back
PICTURE = ROOT / "docs/figures/imports.svg"
FOLDERS = {
    "models": "models",
    "identification": "identification",
    "codegen": "codegen",
    "src/truepose": "",
}

# From the ground up. A room is a folder or a single file, named below `truepose`.
FLOORS = (
    ("arrays", "leaves"),
    ("errors", "wording", "version"),
    ("files", "threads", "pool"),
    ("shown",),
    ("models",),
    ("models.file",),
    ("models.machine",),
    ("models.sensors", "models.builders"),
    ("models.effects",),
    ("models.load", "models.schemas"),
    ("models.effect_text",),
    ("codegen",),
    ("codegen.evaluation",),
    ("identification.prior",),
    ("identification.learned_prior",),
    ("identification.recording",),
    ("identification.prediction",),
    ("identification.fit",),
    ("identification.identifiability", "identification.compensation"),
    ("identification.load", "identification.posterior"),
    ("identification.signatures",),
    ("identification.diagnosis",),
    ("identification.report",),
    ("api",),
    ("commands",),
    ("demo",),
    ("models.leaves.starting",),
    ("models.leaves.export", "codegen.leaves.all_solutions", "codegen.leaves.embedded"),
    (
        "identification.leaves.check",
        "identification.leaves.drift",
        "identification.leaves.fleet",
        "identification.leaves.fringes",
        "identification.leaves.ipopt",
        "identification.leaves.photogrammetry",
        "identification.leaves.planning",
        "identification.leaves.programs",
        "identification.leaves.readers",
        "identification.leaves.shrinking",
    ),
    ("__init__",),
    ("cli",),
    ("__main__",),
)


@dataclass(frozen=True)
class Import:
    """One module uses another; ``lazy`` where the statement stands inside a function."""

    user: str
    used: str
    lazy: bool


def modules() -> dict[str, Path]:
    """Every module of the installed package, named below ``truepose``."""
    out = {}
    for folder, package in FOLDERS.items():
        top = ROOT / folder
        for path in sorted(top.rglob("*.py")):
            parts = path.relative_to(top).with_suffix("").parts
            if folder == "src/truepose" and parts[0] in FOLDERS:
                continue  # the link to a folder that has been read
            if path.name == "__init__.py" and len(ast.parse(path.read_text(encoding="utf-8")).body) <= 1:
                continue  # a docstring
            inner = parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts
            name = ".".join(part for part in (package, *inner) if part)
            out[name.removesuffix(".__init__")] = path
    return out


def imports(known: dict[str, Path]) -> list[Import]:
    """All imports between the modules ``known``, each pair once; lazy only if every such statement is."""
    out: dict[tuple[str, str], bool] = {}
    for user, path in known.items():
        dotted = f"truepose.{user}"
        package = (dotted if path.name == "__init__.py" else dotted.rpartition(".")[0]).split(".")
        for names, lazy in _statements(ast.parse(path.read_text(encoding="utf-8")), package, False):
            for used in {_known(name, known) for name in names} - {None, user}:
                pair = (user, str(used))
                out[pair] = lazy and out.get(pair, True)
    return [Import(*pair, lazy) for pair, lazy in sorted(out.items())]


def room(module: str) -> str:
    """The room that a module stands in: the longest name in ``FLOORS`` that it begins with."""
    rooms = [r for floor in FLOORS for r in floor if module == r or module.startswith(f"{r}.")]
    return max(rooms, key=len, default=module)


def running_back(found: list[Import]) -> list[Import]:
    """Imports from a room to one that is not on a lower floor, or to or from a room on no floor."""
    floor = {r: level for level, rooms in enumerate(FLOORS) for r in rooms}
    out = []
    for one in found:
        above, below = room(one.user), room(one.used)
        if above != below and not floor.get(above, -1) > floor.get(below, len(FLOORS)):
            out.append(one)
    return out


def circles(found: list[Import]) -> list[list[str]]:
    """Groups of modules that reach one another through their imports."""
    names = sorted({name for one in found for name in (one.user, one.used)})
    index = {name: k for k, name in enumerate(names)}
    ends = [index[one.user] for one in found], [index[one.used] for one in found]
    graph = coo_array((np.ones(len(found)), ends), shape=(len(names), len(names)))
    _, label = connected_components(graph, directed=True, connection="strong")
    return [
        [names[k] for k in np.flatnonzero(label == g)] for g, n in Counter(label.tolist()).items() if n > 1
    ]


def labels() -> list[str]:
    """The rooms' names in the picture, top floor first."""
    return [name.replace("__init__", "truepose") for floor in reversed(FLOORS) for name in floor]


def summary(known: dict[str, Path], found: list[Import]) -> str:
    """How many modules, imports, lazy ones, ones that run back, and circles."""
    counts = f"{len(known)} modules, {len(found)} imports ({sum(one.lazy for one in found)} inside functions)"
    return f"{counts}, {len(running_back(found))} run back, {len(circles(found))} circles"


def draw(known: dict[str, Path], found: list[Import], picture: Path) -> None:
    """Write the picture: a row for each room, top floor first; each square counts what it imports from below."""
    rooms = [name for floor in reversed(FLOORS) for name in floor]
    at = {name: k for k, name in enumerate(rooms)}
    between = Counter((room(one.user), room(one.used)) for one in found)
    back = {(room(one.user), room(one.used)) for one in running_back(found)}
    figure = Figure(figsize=(11, 8))
    axes = figure.add_axes((0.36, 0.02, 0.60, 0.72))
    for (user, used), n in between.items():
        if user != used and {user, used} <= at.keys():
            colour = BACK if (user, used) in back else "#1f5fa8"
            shade = 0.15 + 0.6 * min(n / 40, 1)
            axes.add_patch(Rectangle((at[used] - 0.5, at[user] - 0.5), 1, 1, color=colour, alpha=shade))
            axes.text(at[used], at[user], str(n), ha="center", va="center", fontsize=8)
    for k in range(len(rooms)):
        axes.add_patch(Rectangle((k - 0.5, k - 0.5), 1, 1, color="#444444"))
    ticks = range(len(rooms))
    axes.set_yticks(
        ticks, [_size(name, label, known) for name, label in zip(rooms, labels(), strict=True)], fontsize=8
    )
    axes.set_xticks(ticks, labels(), rotation=60, ha="left", fontsize=8)
    axes.tick_params(length=0, top=False, labeltop=True, bottom=False, labelbottom=False)
    axes.set_title(summary(known, found), fontsize=9)
    axes.set(xlim=(-0.5, len(rooms) - 0.5), ylim=(len(rooms) - 0.5, -0.5))
    with mpl.rc_context(
        {"svg.hashsalt": "imports", "svg.fonttype": "none"}
    ):  # the same bytes from the same code
        figure.savefig(picture, metadata={"Date": None})


def _size(name: str, label: str, known: dict[str, Path]) -> str:
    paths = [path for module, path in known.items() if room(module) == name]
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)
    return f"{label}: {len(paths)} {'file' if len(paths) == 1 else 'files'}, {lines:,} lines"


def _statements(node: ast.AST, package: list[str], lazy: bool) -> Iterator[tuple[list[str], bool]]:
    for child in ast.iter_child_nodes(node):
        inside = lazy or isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        if isinstance(child, ast.ImportFrom):
            above = package[: len(package) - child.level + 1] if child.level else []
            base = ".".join([*above, *([child.module] if child.module else [])])
            yield [f"{base}.{alias.name}" for alias in child.names], inside
        elif isinstance(child, ast.Import):
            yield [alias.name for alias in child.names], inside
        yield from _statements(child, package, inside)


def _known(name: str, known: dict[str, Path]) -> str | None:
    """The module that ``truepose.models.lie.exp_so3`` is, or that holds it; None for other packages."""
    if name.partition(".")[0] != "truepose":
        return None
    inner = name.removeprefix("truepose").removeprefix(".")
    holder = inner.rpartition(".")[0] or "__init__"
    return next((one for one in (inner, holder) if one in known), None)


def main() -> None:
    known = modules()
    found = imports(known)
    draw(known, found, PICTURE)
    lines = [summary(known, found)]
    lines += [f"runs back: {one.user} -> {one.used}" for one in running_back(found)]
    lines += [f"circle: {', '.join(circle)}" for circle in circles(found)]
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
