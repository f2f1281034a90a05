"""Folders of results: whose they are, so that no command overwrites what another wrote."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

from truepose.errors import InputError
from truepose.files import check_place

FIT, DIAGNOSIS, DRIFT, FLEET = "fit.json", "diagnosis.json", "drift.json", "fleet.json"
WRITERS = {FIT: "calibrate", DIAGNOSIS: "diagnose", DRIFT: "drift", FLEET: "fleet"}
"""Commands that write a report.html or a folder of machines, by the file that tells that it is theirs."""
CODE = "_kin.h"


def check_directory(path: Path, own: str = "") -> None:
    """Refuse at once what could only fail after the work: a file in the directory's place, another command's result there.

    ``own``: the file of ``WRITERS`` that the command writes. Raises InputError.
    """
    for place in (path, *path.parents):
        with contextlib.suppress(OSError, ValueError):  # `check_place` says why
            if place.exists():
                if not place.is_dir():
                    raise InputError(f"{path}: expected a directory for the results, found the file {place}")
                break
    check_place(path, "directory")
    others = [name for name in WRITERS if own and name != own and (path / name).is_file()]
    if others:
        _refuse(
            path, f"{others[0]}, a result of truepose {WRITERS[others[0]]}", f"one of truepose {WRITERS[own]}"
        )


def check_machine(path: Path, own: str, name: str) -> None:
    """Refuse a folder that holds the same command's result of another machine. Raises InputError."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        held = json.loads((path / own).read_text(encoding="utf-8"))["machine"]
        if held != name:
            _refuse(path, f"a result of the machine {held!r}", f"one of {name!r}")


def check_code(path: Path, name: str) -> None:
    """Refuse a folder that holds another machine's C. Raises InputError."""
    others = sorted(file.name for file in path.glob(f"*{CODE}") if file.name != f"{name}{CODE}")
    if others and not (path / f"{name}{CODE}").exists():
        _refuse(path, f"{others[0]}, another machine's code", f"one of {name!r}")


def _refuse(path: Path, found: str, expected: str) -> None:
    raise InputError(
        f"{path}: found {found}, expected an empty folder or {expected}; nothing is overwritten: give another folder with -o,"
        " or delete this one"
    )
