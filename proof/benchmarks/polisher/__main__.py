"""``python -m benchmarks.polisher``: tables and figures of docs/machines/polisher.md; ``--bundle DIR``: the demo's files."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from . import bundle, charts, errors_model, layers, montecarlo, path, ranks
from .montecarlo import Size

SIZES = tuple(Size(s, s) for s in (0.01, 0.1, 0.2, 0.25, 0.3, 0.5))
FIGURES = Path(__file__).resolve().parents[3] / "docs" / "figures"


def main() -> int:
    """Print the tables, draw the figures."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.polisher", description=__doc__)
    parser.add_argument(
        "--bundle", type=Path, metavar="DIR", help="write recording.csv and truth.json there, no more"
    )
    parser.add_argument("--runs", type=int, default=montecarlo.RUNS, help="noise draws")
    parser.add_argument("--robots", type=int, default=10, help="simulated robots of the layers' tables")
    parser.add_argument("--figures", type=Path, default=FIGURES, metavar="DIR")
    given = parser.parse_args()
    if given.bundle is not None:
        _say(*(str(file) for file in bundle.write(given.bundle)))
        return 0
    _models()
    _ranks()
    _montecarlo(given.runs)
    found = _layers(given.robots)
    _table("A raster over a lens", path.HEAD, path.rows())
    _say(f"{len(path.raster())} points, exact inverse: {path.followed().seconds:.1f} s")
    _say(*(str(file) for file in charts.draw(given.figures, found, min(given.runs, 1000))))
    return 0


def _models() -> None:
    _table("Source errors", errors_model.COUNT_HEAD, errors_model.count_rows())
    _table(
        "Screw theory against exact differentiation",
        errors_model.AGREEMENT_HEAD,
        errors_model.agreement_rows(),
    )


def _ranks() -> None:
    head = ("motion", *(f"{tolerance:g}" for tolerance in ranks.TOLERANCES))
    for angle in ("deg", "rad"):
        _table(f"Rank of H by relative tolerance, columns per mm and {angle}", head, ranks.rank_rows(angle))
    _table(
        "Rank by the order of the spherical axes", ("order", "exact translation", "turned"), ranks.ball_rows()
    )
    spectral = {name: ranks.spectral_rank(turned) for name, turned in ranks.TURNED.items()}
    sequential = {name: len(ranks.kept(turned)) for name, turned in ranks.TURNED.items()}
    _say(f"spectral: {spectral}", f"sequential: {sequential}")
    _table("The sequential set and Table 2", ("limb", "link", "here", "Table 2"), ranks.comparison_rows())
    two = ranks.table_two()
    _say(
        f"Table 2 by appendix A: {two.count} columns of rank {two.rank}",
        f"without effect: {', '.join(two.silent)}",
        f"along a joint's own axis: {', '.join(two.excluded)}",
    )
    without = ranks.without_one_link()
    same = [f"({link}, {limb})" for (limb, link), rank in without.items() if rank == len(ranks.kept())]
    _say(f"145 errors, one link's five left out: rank 54 without (j, i) = {', '.join(same)}; else 50 to 53")


def _montecarlo(runs: int) -> None:
    for angle in ("deg", "rad"):
        title = f"eta in % over {runs} draws, columns per mm and {angle}"
        _table(title, montecarlo.ETA_HEAD, montecarlo.eta_rows(SIZES, angle, runs))
    _say(f"OLS and Liu over {runs} draws: {montecarlo.seconds(runs):.1f} s of one core")
    for size in (Size(0.01, 0.01), Size(0.05, 0.02), Size(0.2, 0.1)):
        title = f"Errors that the models leave, source errors {size.mm} mm and {size.deg} deg"
        _table(title, montecarlo.ERROR_HEAD, montecarlo.error_rows(size, min(runs, 1000)))


def _layers(robots: int) -> list[layers.Found]:
    seeds = range(robots)
    offsets, increments = layers.coarse(layers.cell(Size(0.05, 0.02), 0))
    _say(
        f"coarse calibration of robot 0: {len(increments)} rounds, offsets {offsets.round(5).tolist()} mm, rad"
    )
    found = layers.robots(Size(0.05, 0.02), seeds)
    _table("0.05 mm, 0.02 deg", layers.HEAD, layers.rows(found))
    _table("0.2 mm, 0.1 deg", layers.HEAD, layers.rows(layers.robots(Size(0.2, 0.1), seeds)))
    _table(
        "0.05 mm, 0.02 deg, warming up", layers.HEAD, layers.rows(layers.robots(Size(0.05, 0.02), seeds, 1.0))
    )
    return found


def _table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    lines = [f"\n{title}\n", "| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    _say(*lines, *("| " + " | ".join(row) + " |" for row in rows))


def _say(*lines: str) -> None:
    sys.stdout.write("\n".join(lines) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
