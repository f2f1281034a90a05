"""What a machine file starts from: a table, a URDF, an MJCF or a bundled machine, with what its source says of it.

A bundled machine is a file in ``bundled_arms``: constants as their makers publish them, each with its source. It has
``title``, ``sources``, ``notes``, ``mechanism`` (a section of a machine file, mm and deg), and what its source says beyond:
``gravity``, ``masses``, ``tolerances``, ``frames``, ``sensor``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from truepose.errors import InputError
from truepose.models.file.names import nearest_name
from truepose.models.file.yaml_document import read_document
from truepose.wording import close_matches, shortened

UPRIGHT = (0.0, 0.0, -9.80665)
"""Gravity in a base frame whose z points up, m/s^2."""
TOLERANCES: Mapping[str, float] = {"length": 0.3, "angle": 0.1}
"""mm and deg, 1-sigma: an industrial arm as its workshop leaves it."""


@dataclass(frozen=True)
class Start:
    """A mechanism as a machine file's section, in mm and deg, and what stands beside it.

    ``about`` are sources and notes, one line each. ``described_in`` names the file that says masses and gravity itself.
    ``frames`` and ``sensor`` stand in place of unknown frames and of a pose sensor where the machine has its own.
    ``readings`` are the joints' columns with their units, where the section does not name them (a URDF's).
    ``tested``: the package's own tests build it. ``left_out`` is what the machine has not of its source, one line each.
    """

    name: str
    title: str
    mechanism: Mapping[str, Any]
    about: tuple[str, ...] = ()
    gravity: tuple[float, float, float] | None = UPRIGHT
    masses: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    tolerances: Mapping[str, Any] = field(default_factory=lambda: dict(TOLERANCES))
    frames: Mapping[str, Any] = field(default_factory=dict)
    sensor: str = "pose"
    described_in: str = ""
    readings: Mapping[str, str] = field(default_factory=dict)
    tested: bool = False
    left_out: tuple[str, ...] = ()

    @property
    def called(self) -> str:
        """The name that a machine file can have, next to its own."""
        return nearest_name(self.name)


def readings_of(mechanism: Mapping[str, Any]) -> dict[str, str]:
    """Columns of the joints, each with its unit (mm or deg), of a section ``serial``, ``graph``, ``6-ups`` or ``mount``."""
    if mechanism["type"] == "6-ups":
        return {leg["joint"]: "mm" for leg in mechanism["legs"]}
    if mechanism["type"] == "mount":
        return {mechanism[axis]["name"]: "deg" for axis in ("first", "second")}
    serial = mechanism["type"] == "serial"
    moving = [j for j in mechanism["joints"] if (j["kind"] != "fixed" if serial else j.get("actuated"))]
    return {joint["name"]: "mm" if joint["kind"] == "prismatic" else "deg" for joint in moving}


def unranged(joints: Iterable[Mapping[str, Any]]) -> tuple[str, ...]:
    """Return a line that names the joints with a reading and no range; nothing where all have one."""
    names = [
        j["name"]
        for j in joints
        if (j.get("actuated") or "theta" in j) and j["kind"] != "fixed" and "range" not in j
    ]
    return (f"CHECK joints without a range, which `plan` asks for: {shortened(names, 10)}.",) if names else ()


def tidy(value: Any) -> Any:
    """A copy with numbers as a person writes them: 14 significant digits, whole ones without a point, no minus zero."""
    if isinstance(value, Mapping):
        return {key: tidy(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [tidy(item) for item in value]
    if not isinstance(value, float) or value in (float("inf"), float("-inf")):
        return value
    rounded = float(f"{value:.14g}")
    rounded = 0.0 if abs(rounded) < 1e-13 else rounded
    return int(rounded) if rounded.is_integer() and abs(rounded) < 1e15 else rounded


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
