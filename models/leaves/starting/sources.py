"""From what the command line names to a start: one of a table, a URDF, an MJCF and a machine by name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from truepose.errors import InputError
from truepose.models.leaves.starting.arms import bundled_start
from truepose.models.leaves.starting.start import Start
from truepose.wording import joined


@dataclass(frozen=True)
class Source:
    """Where the mechanism comes from, and what is asked of it; empty where nothing was said."""

    table: Path | None = None
    convention: str = ""
    urdf: Path | None = None
    mjcf: Path | None = None
    arm: str = ""
    base: str = ""
    tip: str = ""
    written_out: bool = False

    @property
    def kind(self) -> str:
        """Which of the four, empty for none. Raises InputError for several."""
        named = {"--table": self.table, "--urdf": self.urdf, "--mjcf": self.mjcf, "--arm": self.arm}
        given = [option for option, value in named.items() if value]
        if len(given) > 1:
            raise InputError(f"found {joined(given)}, expected one of them")
        return given[0] if given else ""


def start_from(source: Source, output: Path) -> Start:
    """The start of a source for a machine file ``output``. Raises InputError where the source is none or says nothing.

    Readers are imported when they are needed: most of them take longer to load than to run.
    """
    kind = source.kind
    if source.convention and kind != "--table":
        raise InputError(
            "--convention: found it without --table, expected a table that it is the convention of"
        )
    if source.table is not None:
        from truepose.models.leaves.starting.table import table_start

        return table_start(source.table, source.convention)
    if source.urdf is not None:
        from truepose.models.leaves.starting.urdf import urdf_start

        return urdf_start(source.urdf, output, source.base, source.tip, written_out=source.written_out)
    if source.mjcf is not None:
        from truepose.models.leaves.starting.mjcf import mjcf_start

        return mjcf_start(source.mjcf, source.tip)
    if not source.arm:
        raise InputError("found no source of the mechanism, expected --table, --urdf, --mjcf or --arm")
    from truepose.models.leaves.starting.descriptions import described, described_start

    if described(source.arm):
        return described_start(source.arm, output, source.base, source.tip, written_out=source.written_out)
    return bundled_start(source.arm)
