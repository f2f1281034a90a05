"""Generated C with what it takes on an emulated controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from truepose.codegen.c import generate
from truepose.codegen.features import ALL, Features
from truepose.codegen.leaves.embedded.measure import OPTIMISATIONS, Measurement, measure
from truepose.codegen.leaves.embedded.section import sizes_section
from truepose.codegen.leaves.embedded.toolchain import required
from truepose.codegen.printer import Real
from truepose.files import atomic_directory
from truepose.models.machine.machine import Machine


def generate_measured(
    machine: Machine,
    directory: Path,
    real: Real = "double",
    *,
    nominal: Mapping[str, float] | None = None,
    optimisations: Sequence[str] = OPTIMISATIONS,
    features: Features = ALL,
) -> tuple[list[Path], list[Measurement]]:
    """``generate``, with a section of measurements at the end of README.md; the paths, and the measurements.

    Unlike what ``generate`` writes, README.md then depends on the compiler and the emulator of this computer, both
    of which it names. Raises InputError as ``generate`` and ``measure`` do; nothing is written then.
    """
    tools = required()
    with atomic_directory(directory) as partial:
        files = generate(machine, partial, real, nominal=nominal, features=features)
        measured = [
            measure(partial, machine.name, optimisation=level, tools=tools) for level in optimisations
        ]
        readme = partial / "README.md"
        text = readme.read_text(encoding="utf-8") + "\n" + sizes_section(measured)
        readme.write_text(text, encoding="utf-8", newline="\n")
    return [Path(directory) / file.relative_to(partial) for file in files], measured
