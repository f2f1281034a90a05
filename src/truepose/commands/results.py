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
        raise InputError(
            f"{path}: found {others[0]}, a result of truepose {WRITERS[others[0]]}, expected an empty folder or one of truepose"
            f" {WRITERS[own]}; nothing is overwritten: give another folder with -o, or delete this one"
        )


def check_machine(path: Path, own: str, name: str) -> None:
    """Refuse a folder that holds the same command's result of another machine. Raises InputError."""
    try:
        held = json.loads((path / own).read_text(encoding="utf-8"))["machine"]
    except (OSError, ValueError, KeyError, TypeError):
        return
    if held != name:
        raise InputError(
            f"{path}: found a result of the machine {held!r}, expected an empty folder or one of {name!r}; nothing is"
            " overwritten: give another folder with -o, or delete this one"
        )


def check_code(path: Path, name: str) -> None:
    """Refuse a folder that holds another machine's C. Raises InputError."""
    others = sorted(file.name for file in path.glob(f"*{CODE}") if file.name != f"{name}{CODE}")
    if others and not (path / f"{name}{CODE}").exists():
        raise InputError(
            f"{path}: found {others[0]}, another machine's code, expected an empty folder or one of {name!r}; nothing is"
            " overwritten: give another folder with -o, or delete this one"
        )


__all__ = ["DIAGNOSIS", "DRIFT", "FIT", "FLEET", "check_code", "check_directory", "check_machine"]
