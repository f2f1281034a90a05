"""Write the demo: ``python -m benchmarks.telescope_simulator OUTDIR``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from telescope_simulator.bundle import write


def main() -> int:
    """Write machine.yaml, recording.csv and truth.json of the telescope demo."""
    parser = argparse.ArgumentParser(prog="telescope_simulator", description=main.__doc__)
    parser.add_argument("outdir", type=Path, metavar="OUTDIR")
    for path in write(parser.parse_args().outdir):
        sys.stdout.write(f"{path}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
