"""The program ``truepose``."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line. Ctrl-C is one line here, too, while libraries load."""
    try:
        from truepose.cli import main as run

        run()
    except KeyboardInterrupt:
        sys.stderr.write("error: stopped\n")
        sys.exit(130)


if __name__ == "__main__":
    main()
