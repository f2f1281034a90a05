"""A page in headless Chromium: what its console says, and what a script that is added to a copy of it finds there."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--no-first-run", "--hide-scrollbars",
    "--virtual-time-budget=8000", "--enable-logging=stderr",
)  # fmt: skip
_FOUND = re.compile(r'<pre id="found-by-test"[^>]*>(.*?)</pre>', re.DOTALL)


def browser() -> str | None:
    """The browser's program; None where there is none."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


def tried(
    page: str, script: str, folder: Path, width: int, height: int = 900, *flags: str
) -> tuple[Any, list[str]]:
    """What ``script``, the body of a function, returns once the page stands, and the lines of the console.

    An error of the page, or of the script, is a line of the console. A page that names the scripts that it allows allows this
    one as well.
    """
    last = (
        "window.addEventListener('load', function () { var found = (function () {"
        f"{script}"
        "})(); var pre = document.createElement('pre'); pre.id = 'found-by-test'; pre.hidden = true;"
        " pre.textContent = JSON.stringify(found); document.body.appendChild(pre); });"
    )
    digest = base64.b64encode(hashlib.sha256(last.encode()).digest()).decode()
    allowed = page.replace(
        "script-src ", f"script-src 'sha256-{digest}' ", 1
    )  # where the page says which scripts may run
    file = folder / f"page-{width}.html"
    file.write_text(allowed.replace("</body>", f"<script>{last}</script></body>"), encoding="utf-8")
    program = browser()
    assert program is not None
    profile, size = f"--user-data-dir={folder / 'profile'}", f"--window-size={width},{height}"
    command = [program, *FLAGS, profile, size, *flags, "--dump-dom", file.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)
    found = _FOUND.search(done.stdout)
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert found is not None, console
    return json.loads(unescape(found[1])), console
