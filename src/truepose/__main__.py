"""The program ``truepose``. Ctrl-C is heard from here on, and libraries take a moment to load: so they come afterwards."""

from __future__ import annotations

from truepose import faults


def _run() -> None:
    from truepose.cli import run

    run()


def main() -> None:
    """Entry point of the console command."""
    faults.main(_run)


if __name__ == "__main__":
    main()
