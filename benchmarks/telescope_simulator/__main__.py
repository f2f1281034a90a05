"""Write the demo: python -m telescope_simulator OUTDIR, from benchmarks/ (or give the path of this file)."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

if not __package__:  # run as a file or folder: make the package importable by its name
    sys.path[0] = str(Path(__file__).resolve().parent.parent)


def main() -> int:
    """Write machine.yaml, recording.csv and truth.json of the telescope demo."""
    from telescope_simulator.bundle import write

    parser = argparse.ArgumentParser(prog="telescope_simulator", description=main.__doc__)
    parser.add_argument("outdir", type=Path, metavar="OUTDIR")
    for path in write(parser.parse_args().outdir):
        sys.stdout.write(f"{path}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
