"""Read recordings for a machine, with columns that a leaf can make where files have none (``loading``)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from truepose.identification.recording.load import Sources, tables
from truepose.identification.recording.load import load_recording as load_rows
from truepose.identification.recording.recording import Recording
from truepose.leaves import modules_named
from truepose.models.machine.machine import MachineLike, as_machine


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
