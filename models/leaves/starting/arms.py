"""Bundled nominal machines, one file each in ``bundled_arms``: constants as their makers publish them, each with its source.

A file has ``title``, ``sources``, ``notes``, ``mechanism`` (a section of a machine file, mm and deg), and what its source
says beyond: ``gravity``, ``masses``, ``tolerances``, ``frames``, ``sensor``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from truepose.errors import InputError
from truepose.models.file.yaml_document import read_document
from truepose.models.leaves.starting.start import TOLERANCES, Start
from truepose.wording import close_matches

_FOLDER = Path(__file__).parent / "bundled_arms"


def bundled() -> Mapping[str, str]:
    """Titles of the bundled machines by name, sorted."""
    return {path.stem: str(read_document(path)["title"]) for path in sorted(_FOLDER.glob("*.yaml"))}


def bundled_names() -> tuple[str, ...]:
    """Names of the bundled machines, sorted."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))


def bundled_start(name: str) -> Start:
    """The start of a bundled machine. Raises InputError with the names meant, or those there are."""
    names = bundled_names()
    own = "".join(letter for letter in name.lower() if letter not in " _.")
    if own not in names:
        raise InputError(f"--arm: found {name!r}, expected a bundled machine; {close_matches(own, names)}")
    document: dict[str, Any] = read_document(_FOLDER / f"{own}.yaml")
    about = [f"Source: {source}" for source in document["sources"]]
    gravity = document.get("gravity")
    return Start(
        name=own,
        title=document["title"],
        mechanism=document["mechanism"],
        about=(*about, *(f"Note: {note}" for note in document.get("notes", ()))),
        gravity=None if gravity is None else (gravity[0], gravity[1], gravity[2]),
        masses=document.get("masses", {}),
        tolerances=document.get("tolerances", dict(TOLERANCES)),
        frames=document.get("frames", {}),
        sensor=document.get("sensor", "pose"),
        tested=True,
    )
