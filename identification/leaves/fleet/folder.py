"""The folder of a fleet: which machines it holds, and which files are each one's.

Three layouts, which may be mixed:

* ``DIR/NAME/``: a machine file (``machine.yaml``, or the only ``.yaml`` there) beside its recordings;
* ``DIR/NAME/recordings/``: the recordings in a folder of their own; then nothing beside it counts as one;
* ``DIR/machine.yaml``: a machine file that all share who have none; a recording ``DIR/NAME.csv`` then is a machine, too.

Several recordings of a machine are taken together, in the order of their names. Names that begin with a dot are passed over.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from truepose.errors import InputError
from truepose.wording import shortened

SHARED = "machine.yaml"
"""Name of a machine file, in a machine's folder or for all."""
RECORDINGS = "recordings"
_MACHINE = (".yaml", ".yml")
_TABLE = (
    ".csv", ".tsv", ".txt", ".dat", ".parquet", ".pq", ".xlsx", ".xls", ".mcap", ".db3", ".bag",
)  # fmt: skip
_REFERRED = re.compile(r"\bfile:\s*(?:\"([^\"]*)\"|'([^']*)'|([^\s,}#]+))")
"""A file that a machine file names, such as a URDF."""


@dataclass(frozen=True)
class Member:
    """One machine: its files, or ``why`` they are none that can be worked with."""

    name: str
    machine: Path | None = None
    recordings: tuple[Path, ...] = ()
    why: str = ""

    @property
    def inputs(self) -> tuple[Path, ...]:
        """The machine file, then the recordings."""
        return self.recordings if self.machine is None else (self.machine, *self.recordings)

    @property
    def files(self) -> tuple[Path, ...]:
        """Everything that is read for it, what its machine file names as well."""
        if self.machine is None:
            return self.recordings
        text = self.machine.read_text(encoding="utf-8", errors="replace")
        named = {
            self.machine.parent / next(filter(None, found)) for found in _REFERRED.findall(text) if any(found)
        }
        return (self.machine, *sorted(path for path in named if path.is_file()), *self.recordings)

    def key(self, folder: Path, settings: str) -> str:
        """SHA-256 of what its result depends on: names and contents of its files, and the ``settings`` of the run."""
        whole = hashlib.sha256(f"{settings}\0{self.name}\0{self.why}".encode())
        for file in () if self.why else self.files:
            with file.open("rb") as stream:
                own = hashlib.file_digest(stream, "sha256").hexdigest()
            whole.update(f"\0{_relative(file, folder)}\0{own}".encode())
        return whole.hexdigest()


def members(folder: Path, but: Path) -> tuple[Member, ...]:
    """The machines of a fleet, by name; ``but`` is the folder of results, which may lie inside.

    Raises InputError where there is none.
    """
    if not folder.is_dir():
        raise InputError(
            f"{folder}: expected a folder of machines, found {'a file' if folder.exists() else 'nothing'}"
        )
    inside = [path for path in _visible(folder) if path.resolve() != but.resolve()]
    shared = folder / SHARED if (folder / SHARED).is_file() else None
    found = [_of_folder(path, shared) for path in inside if path.is_dir()]
    if shared is not None:
        found += [Member(_name(path.stem), shared, (path,)) for path in _tables(inside)]
    if not found:
        raise InputError(
            f"{folder}: found no machine, expected a folder for each with {SHARED} and recordings in it, or one {SHARED}"
            " beside a recording of each"
        )
    times = Counter(member.name for member in found)
    why = "found several folders or recordings of this name, expected one"
    found = [Member(one.name, why=why) if times[one.name] > 1 else one for one in found]
    return tuple(sorted({member.name: member for member in found}.values(), key=lambda member: member.name))


def _of_folder(path: Path, shared: Path | None) -> Member:
    """The machine of one folder."""
    name, inside = _name(path.name), _visible(path)
    own = [file for file in inside if file.suffix.lower() in _MACHINE and file.is_file()]
    machine = next((file for file in own if file.name == SHARED), own[0] if len(own) == 1 else None)
    apart = path / RECORDINGS
    tables = tuple(_tables(_visible(apart) if apart.is_dir() else inside))
    member = Member(name, machine or (None if own else shared), tables)
    if member.machine is None and own:
        names = shortened([file.name for file in own], 3)
        return replace(member, why=f"found the machine files {names}, expected one, or one called {SHARED}")
    if member.machine is None:
        return replace(
            member, why=f"found no machine file, expected {SHARED} here, or one beside all machines"
        )
    if not tables:
        where = f"in {RECORDINGS}" if apart.is_dir() else "here"
        return replace(member, why=f"found no recording {where}, expected at least one ({', '.join(_TABLE)})")
    return member


def _tables(files: Iterable[Path]) -> list[Path]:
    return [file for file in files if file.suffix.lower() in _TABLE and file.is_file()]


def _visible(folder: Path) -> Sequence[Path]:
    return sorted(path for path in folder.iterdir() if not path.name.startswith("."))


def _name(text: str) -> str:
    """A name that can be written into any file: bytes that are no UTF-8 are spelt out."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def _relative(file: Path, folder: Path) -> str:
    """A file as seen from the fleet's folder."""
    return _name(file.relative_to(folder).as_posix() if file.is_relative_to(folder) else file.name)
