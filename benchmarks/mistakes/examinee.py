"""One sitting in a process of its own: ``python examinee.py MACHINE RECORDING... FIX OUT``, all paths.

Writes what ``truepose check --json`` printed, its exit code and its seconds: those of the command alone, libraries loaded.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import time
from importlib import import_module
from pathlib import Path

LIBRARIES = ("casadi", "pandas", "pint", "pydantic", "scipy.optimize", "scipy.spatial.transform", "yaml")


def main(machine: str, *others: str) -> None:
    """Run the command and note down what came of it."""
    *recordings, fix, out = others
    for name in LIBRARIES:
        import_module(name)
    from truepose.cli import app

    heard, code, said = io.StringIO(), 0, ""
    start = time.perf_counter()
    with contextlib.redirect_stdout(heard):
        try:
            app(["check", machine, *recordings, "--json", "--fix", fix])
        except SystemExit as exc:
            code = exc.code if isinstance(exc.code, int) else 1
        except Exception as exc:  # a traceback is a result as well: the table tells
            code, said = 1, f"{type(exc).__name__}: {exc}"
    seconds = time.perf_counter() - start
    about = {"exit": code, "seconds": round(seconds, 3), "said": said, "printed": heard.getvalue()}
    Path(out).write_text(json.dumps(about), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
