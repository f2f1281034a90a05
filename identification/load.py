"""Read recordings for a machine, with columns that a leaf can make where files have none (``loading``).

The gate before a fit: whether a machine file and its recordings belong together, where a leaf can tell.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from truepose.identification.recording.load import Sources, tables, try_columns
from truepose.identification.recording.load import load_recording as load_rows
from truepose.identification.recording.recording import Recording
from truepose.leaves import modules_named
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine, MachineLike, as_machine


def load_recording(
    machine: MachineLike,
    source: Sources,
    *,
    need_observations: bool = True,
    irradiance: Sequence[Path | str] = (),
    shuffled: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Recording:
    """One or several recordings as one: paths, DataFrames or dicts of columns, in the units of the machine file unless
    a header says otherwise. Raises InputError naming file, row and column.

    ``irradiance``: tables of photocurrents, one for each file without a column ``dL``, in the same order; their
    fringes are counted. ``shuffled``: rows are no visits one after the other (a comment ``# order: shuffled`` in a file
    says the same), so that nothing is looked for that depends on how joints came to a row.
    """
    machine = as_machine(machine)
    files = tables(source, machine.mechanism.readings)
    for leaf in modules_named("loading") if need_observations else ():
        made: Recording | None = leaf.load_counted(machine, files, irradiance, shuffled, progress)
        if made is not None:
            return made
    return load_rows(machine, files, need_observations=need_observations, shuffled=shuffled)


@dataclass(frozen=True)
class Caution:
    """What stands above a result: sentences for readers, and the same for its JSON, both empty where all is well.

    ``refusal`` says why no fit should be made of these files; it is empty where nothing speaks against one.
    """

    verdict: str = "ok"
    sentences: tuple[str, ...] = ()
    document: Mapping[str, object] = field(default_factory=dict)
    refusal: str = ""


def load_checked(
    machine: Path,
    recordings: Sequence[Path],
    *,
    irradiance: Sequence[Path] = (),
    tried: Sequence[str] | None = None,
    shuffled: bool = False,
) -> tuple[Caution, Machine | None, Recording | None]:
    """Load a machine and its rows and check them; one that cannot be loaded for a reason that the caution tells is None.

    ``tried``: columns that nobody declared and that are to be drivers (none named: all). ``shuffled`` rows are no visits
    one after the other. Raises InputError for what cannot be read.
    """
    for gate in modules_named("gate"):
        checked: tuple[Caution, Machine | None, Recording | None] = gate.load_checked(
            machine, recordings, irradiance=irradiance, tried=tried, shuffled=shuffled
        )
        return checked
    loaded = load_machine(machine)
    if tried is not None:
        loaded = try_columns(loaded, recordings, tried)
    return Caution(), loaded, load_recording(loaded, recordings, irradiance=irradiance, shuffled=shuffled)
