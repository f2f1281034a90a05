"""Pictures of reports for the site: each at three widths, light and dark, as a browser shows their first screen.

    python docs/report_pictures.py NAME=REPORT.html ...

writes ``figures/reports/NAME-WIDTH-light.png`` and its dark twin. Needs Chromium.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

FIGURES = Path(__file__).resolve().parent / "figures" / "reports"
SIZES = ((500, 1150), (1000, 1250), (1600, 1000))
COLOURS = 128
NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
DARK = ("--force-dark-mode", "--blink-settings=preferredColorScheme=0")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--hide-scrollbars",
    "--virtual-time-budget=8000",
)


def shown(report: Path, picture: Path, size: tuple[int, int], *flags: str) -> None:
    """The first screen of a report in a window of this size, as a PNG of few colours."""
    program = next((path for name in NAMES if (path := shutil.which(name))), None)
    if program is None:
        raise SystemExit(f"found no browser, expected one of {', '.join(NAMES)}")
    with tempfile.TemporaryDirectory() as profile:
        own = (f"--user-data-dir={profile}", f"--window-size={size[0]},{size[1]}", f"--screenshot={picture}")
        subprocess.run(
            [program, *FLAGS, *flags, *own, report.resolve().as_uri()], check=True, capture_output=True
        )
    Image.open(picture).convert("RGB").quantize(COLOURS).save(picture, optimize=True)


def main(arguments: list[str]) -> None:
    """All pictures of the reports that are named."""
    FIGURES.mkdir(parents=True, exist_ok=True)
    for argument in arguments:
        name, _, report = argument.partition("=")
        for size in SIZES:
            shown(Path(report), FIGURES / f"{name}-{size[0]}-light.png", size)
            shown(Path(report), FIGURES / f"{name}-{size[0]}-dark.png", size, *DARK)


if __name__ == "__main__":
    main(sys.argv[1:])
