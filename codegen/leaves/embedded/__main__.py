"""Measure directories of generated C and print their tables: ``python -m truepose.codegen.leaves.embedded DIR... [-O s]``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from truepose.codegen.leaves.embedded.measure import OPTIMISATIONS, measure
from truepose.codegen.leaves.embedded.section import sizes_section
from truepose.errors import InputError


def main(arguments: list[str] | None = None) -> int:
    """Print a table for each directory; 2 when one cannot be measured."""
    parser = argparse.ArgumentParser(prog="python -m truepose.codegen.leaves.embedded", description=__doc__)
    parser.add_argument(
        "directories", metavar="DIR", nargs="+", type=Path, help="what `truepose codegen` wrote"
    )
    parser.add_argument("-O", dest="levels", action="append", metavar="LEVEL", help="2, s, ...; default both")
    chosen = parser.parse_args(arguments)
    levels = [f"-O{level}" for level in chosen.levels] if chosen.levels else list(OPTIMISATIONS)
    try:
        for directory in chosen.directories:
            section = sizes_section([measure(directory, optimisation=level) for level in levels])
            sys.stdout.write(f"{directory}\n\n{section}\n")
    except InputError as exc:
        sys.stderr.write(f"error: {exc}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
