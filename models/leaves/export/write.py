"""``export``: a calibrated machine as a file of another format, with what that format cannot hold said.

A format is a file in ``truepose.models.leaves.export.formats``: a class with its writer and its reader, registered by
``@formats.add("name")``. Each text is read back before it is published: it must hold the machine that was meant. What a format
cannot hold is not compared.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Final
from xml.etree.ElementTree import ParseError

import numpy as np
import yaml

from truepose.arrays import Array
from truepose.errors import InputError, ReadBackError
from truepose.files import atomic_write_text
from truepose.models.leaves.export.held import SAMPLES, held, losses, sample_readings
from truepose.models.leaves.export.links import Tree, TreeJoint, frames_of, links_of, tree_of
from truepose.models.machine.machine import Machine, MachineLike, as_machine
from truepose.models.registry import Registry
from truepose.wording import joined

LISTED = 5
"""Effects that a note names; the file names all."""
ALL = 1_000_000
ROWS = 10
"""Rows of readings at which poses are compared."""
SAME: Final = 1e-10
"""Largest difference of a pose, as a share of the machine's reach or of a radian. Numbers are written as texts that read as
the same doubles, and what is below 1e-15 m or rad as zero: a hundred frames one after the other lose a thousandth of this."""


@dataclass(frozen=True)
class Exported:
    """A text in a format and what it lacks.

    ``left_out`` is the largest change of the tool's position (mm) by each effect that the format cannot hold, ``lost``
    that by all of them; ``frozen`` are the drivers' values at which other effects, and tools of recordings, are held.
    """

    format: str
    text: str
    left_out: Mapping[str, float] = field(default_factory=dict)
    lost: float = 0.0
    frozen: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


class Format(ABC):
    """A format: its name, what sentences call it, the suffixes of its files, its writer and its reader."""

    name: ClassVar[str]
    title: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]

    @abstractmethod
    def render(self, machine: Machine) -> Exported:
        """Return the text of a machine, and what it lacks. Raises InputError as ``export`` does."""

    @abstractmethod
    def differences(self, text: str, machine: Machine) -> Iterator[str]:
        """Yield in words what a text and a machine do not share."""

    def frozen_lines(self, frozen: Mapping[str, Mapping[str, float]], most: int) -> list[str]:
        """Return the line that says at which values of their drivers effects are held, if any are."""
        named = [
            f"{label} ({', '.join(f'{name} = {value:.12g}' for name, value in drivers.items())})"
            for label, drivers in frozen.items()
        ]
        return (
            [f"{self.title} holds only at these values of their drivers: {_listed(named, most)}"]
            if named
            else []
        )


class LinkFormat(Format):
    """A format of rigid links: constants, and effects that are constants, are held exactly."""

    @abstractmethod
    def text(self, machine: Machine, tree: Tree, notes: Sequence[str]) -> str:
        """Return the text of a machine's tree; ``notes`` stand in comments at its head."""

    @abstractmethod
    def compare(self, text: str, machine: Machine, meant: Tree) -> Iterator[str]:
        """Yield how what a text holds differs from a tree."""

    def render(self, machine: Machine) -> Exported:
        holding = held(machine)
        tree = tree_of(machine, holding.values, self.title)
        each, together = losses(machine, tree, holding.left)

        def lines(most: int) -> list[str]:
            """Return the notes, in which so many effects are named, largest first."""
            left = [
                f"{self.title} cannot hold, and leaves out: {listed_sizes(each, most)}; together up to "
                f"{together:.3g} mm at the tool ({SAMPLES} poses, drivers at their defaults)"
            ] * bool(each)
            return left + self.frozen_lines(holding.frozen, most)

        text = self.text(machine, tree, lines(ALL))
        return Exported(self.name, text, each, together, holding.frozen, tuple(lines(LISTED)))

    def differences(self, text: str, machine: Machine) -> Iterator[str]:
        return self.compare(text, machine, tree_of(machine, held(machine).values, self.name))


class JointFormat(LinkFormat):
    """A format whose texts list joints, by which all links can be compared."""

    @abstractmethod
    def read(self, text: str, root: str) -> list[TreeJoint]:
        """Return the joints of a text that was rendered, parents first; ``root`` is the first link."""

    def compare(self, text: str, machine: Machine, meant: Tree) -> Iterator[str]:
        """Yield which ranges of joints, and which frames of links, differ from a tree's."""
        links = links_of(machine, meant)
        joints = self.read(text, links.root)
        found = {joint.name: joint.range for joint in joints}
        for joint in links.joints:  # where the machine states no range a format may have a wide one
            if joint.range and not np.allclose(found[joint.name] or np.inf, joint.range, rtol=SAME, atol=0.0):
                yield f"the range of {joint.name} is {found[joint.name]}, expected {joint.range} (mm, rad)"
        for readings in sample_rows(machine):
            frames = (frames_of(each, readings, links.root) for each in (joints, links.joints))
            yield from compare_frames(*frames)


def follow_read(joints: list[TreeJoint], name: str, lead: str, factor: float) -> None:
    """Let one of some joints follow another by a ``factor`` in m and rad. Raises LookupError for a name of none."""
    places = {joint.name: k for k, joint in enumerate(joints)}
    own, other = joints[places[name]], joints[places[lead]]
    joints[places[name]] = replace(own, follows=(lead, factor * own.unit / other.unit))


formats: Registry[type[Format]] = Registry("export format", "truepose.models.leaves.export.formats")


def export(machine: MachineLike, path: Path | str, format: str | None = None) -> Exported:
    """Write ``machine`` to ``path`` in a format, by the path's suffix where ``format`` is None.

    In descriptions of links (``urdf``, ``mjcf``, ``ur-kinematics``) constants, and constant effects, are held exactly; in
    volumetric tables (``iso230``) all that each axis does by itself. What else is left out is in the result, in ``notes``
    and, in full, in a comment of the file. The same machine gives the same bytes.

    Raises InputError for an unknown format, the machine's own file, a machine with loops or passive joints, for
    ``ur-kinematics`` where the machine is no chain of six revolute joints, and for a table where it has no linear axis. Raises
    ReadBackError, and writes nothing, where the text would not be read as the machine.
    """
    machine = as_machine(machine)
    chosen = formats.get(format_of(path, format), "format")()
    if machine.file is not None and Path(path).resolve() == machine.file.path.resolve():
        raise InputError(f"{path}: found the machine file itself, expected another file to write")
    done = chosen.render(machine)
    check_export(chosen, done.text, machine, str(path))
    atomic_write_text(path, done.text)
    return done


def render(machine: Machine, format: str) -> Exported:
    """Return the text of a machine in a format, and what it lacks. Raises InputError as ``export`` does."""
    return formats.get(format, "format")().render(machine)


def format_of(path: Path | str, format: str | None) -> str:
    """Return the format that is named, or that a path's suffix means. Raises InputError where there is none."""
    if format is not None:
        return formats.get(format, "format").name
    by_suffix: dict[str, list[str]] = {}
    for known in formats:
        for ending in formats.get(known, "format").suffixes:
            by_suffix.setdefault(ending, []).append(known)
    suffix = Path(path).suffix
    if suffix.lower() not in by_suffix:
        expected = f"{', '.join(by_suffix)}, or --format {'|'.join(formats)}"
        raise InputError(f"{path}: found the suffix {suffix!r}, expected {expected}")
    first, *others = by_suffix[suffix.lower()]
    if others:
        raise InputError(
            f"{path}: found the suffix of {joined([first, *others])}, expected --format with one of them"
        )
    return first


def check_export(format: Format, text: str, machine: Machine, name: str) -> None:
    """Raise ReadBackError, which ``name`` opens, unless a text in a format holds a machine: a fault of truepose."""
    try:
        difference = next(format.differences(text, machine), None)
    except (InputError, ParseError, yaml.YAMLError, LookupError, ValueError) as exc:
        told = f"found no {exc}" if isinstance(exc, KeyError) else " ".join(str(exc).split())
        raise ReadBackError(f"{name}: what was to be written cannot be read: {told}") from exc
    if difference is not None:
        raise ReadBackError(f"{name}: what was to be written reads as another machine: {difference}")


def sample_rows(machine: Machine) -> Iterator[dict[str, float]]:
    """Yield readings, mm and rad by joint name, at which a text is compared with its machine."""
    for row in sample_readings(machine)[:ROWS].tolist():
        yield dict(zip(machine.mechanism.readings, row, strict=True))


def compare_frames(found: Mapping[str, Array], meant: Mapping[str, Array]) -> Iterator[str]:
    """Yield which frames (4, 4) mm are missing or elsewhere."""
    reach = max(1.0, *(float(np.max(np.abs(pose[:3, 3]))) for pose in meant.values()))
    for name, pose in meant.items():
        if name not in found:
            yield f"the frame {name} is missing"
            continue
        away = float(np.max(np.abs(found[name] - pose) / [1.0, 1.0, 1.0, reach]))
        if not away <= SAME:
            yield f"the frame {name} is off by {away:.1e} of its reach"


def listed_sizes(sizes: Mapping[str, float], most: int) -> str:
    """Return labels with their sizes (mm), largest first, and how many more there are."""
    ordered = sorted(sizes.items(), key=lambda item: -item[1])
    return _listed((f"{label} ({size:.3g} mm)" for label, size in ordered), most)


def _listed(items: Iterable[str], most: int) -> str:
    named = list(items)
    more = [f"and {len(named) - most} more"] if len(named) > most else []
    return ", ".join(named[:most] + more)
