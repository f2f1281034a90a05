"""Measurements as Markdown: the section of a generated README, and the same table for a terminal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from truepose.codegen.c import generate
from truepose.codegen.features import ALL, Features
from truepose.codegen.leaves.embedded.measure import OPTIMISATIONS, Chain, Cost, Measurement, measure
from truepose.codegen.leaves.embedded.program import Sizes
from truepose.codegen.leaves.embedded.toolchain import required
from truepose.codegen.printer import Real
from truepose.files import atomic_directory
from truepose.models.machine.machine import Machine

_Row = tuple[str, Callable[[Measurement], str]]


def sizes_section(measurements: Sequence[Measurement]) -> str:
    """The section "Measured" of one machine's README, a column a measurement; "" without any."""
    if not measurements:
        return ""
    first = measurements[0]
    lines = ["## Measured", "", *_introduction(first), "", *table(measurements), ""]
    lines += [
        "Instructions are counted, not cycles: how many cycles they take depends on the core, its caches and its memory.",
        f"Compiled by `{first.compiler}` with `{' '.join(first.target.flags)}`,",
        f"run by `{first.emulator}` (`-machine {first.target.machine}`).",
    ]
    return "\n".join(lines) + "\n"


def table(measurements: Sequence[Measurement]) -> list[str]:
    """Lines of a Markdown table, a column a measurement."""
    heads = [f"{m.target.title}, `{m.optimisation}`" for m in measurements]
    lines = ["| | " + " | ".join(heads) + " |", "|---|" + "---|" * len(heads)]
    for title, cell in [*_rows(measurements[0].name), *(_state_rows(measurements))]:
        lines.append(f"| {title} | " + " | ".join(cell(m) for m in measurements) + " |")
    return lines


def summary(measurements: Sequence[Measurement]) -> list[str]:
    """A line of plain text for each measurement."""
    return [_sentence(m) for m in measurements]


def _sentence(m: Measurement) -> str:
    stack = max(m.warm.stack, m.inverse.stack)
    cold = f", {m.cold.most:,} at most cold" if m.cold else ""
    return (
        f"{m.target.title} {m.optimisation}: {m.object.text:,} B of code; an inverse takes {m.warm.median:,.0f} "
        f"instructions warm{cold}, and {stack:,} B of stack"
    )


def _introduction(first: Measurement) -> list[str]:
    return [
        f"On {first.target.title}, over the {first.vectors} test vectors. Warm: the guess of `{first.name}_ik` stands",
        "1 deg (lengths: 0.5 % of the vectors' span) from the solution in every joint; cold: it is another vector's joints.",
        "Stack is what a call wrote below its caller's frame.",
    ]


def _rows(name: str) -> list[_Row]:
    return [
        (f"`{name}_kin.o`: text, data, bss [B]", lambda m: _sizes(m.object)),
        (f"linked for `{name}_ik` alone, with its part of the C library [B]", lambda m: _sizes(m.linked_ik)),
        (f"linked for `{name}_fk` alone [B]", lambda m: _sizes(m.linked_fk)),
        (f"`{name}_ik` warm: instructions, mean, median, most", lambda m: _instructions(m.warm)),
        (f"`{name}_ik` cold: instructions, mean, median, most", lambda m: _if_cold(m, _instructions)),
        (f"`{name}_ik` out of reach, the longest: instructions", lambda m: f"{m.longest:,}"),
        (f"`{name}_fk`: instructions, mean, median, most", lambda m: _instructions(m.fk)),
        (f"`{name}_jac`: instructions, mean, median, most", lambda m: _instructions(m.jac)),
        (f"`{name}_compensate`: instructions, mean, median, most", lambda m: _instructions(m.compensate)),
        (f"`{name}_ik` warm: stack, median and most [B]", lambda m: _stack(m.warm)),
        (f"`{name}_ik` cold: stack, median and most [B]", lambda m: _if_cold(m, _stack)),
        (
            f"`{name}_fk`, `{name}_jac`, `{name}_compensate`: stack, most [B]",
            lambda m: ", ".join(f"{cost.stack:,}" for cost in (m.fk, m.jac, m.compensate)),
        ),
        (
            f"`{name}_ik`: stack reserved by its deepest calls, without the C library [B]",
            lambda m: _chain(m.chain_ik),
        ),
        (
            f"calls that did not return 0: `{name}_fk`, `{name}_ik` warm, cold",
            lambda m: ", ".join(
                str(sum(cost.codes[1:])) for cost in (m.fk, m.warm, *([m.cold] if m.cold else []))
            ),
        ),
        (f"largest error of `{name}_fk`", lambda m: _errors(m.fk)),
        (f"largest error of `{name}_ik`, warm or cold", lambda m: _errors(m.warm, m.inverse)),
    ]


def _state_rows(measurements: Sequence[Measurement]) -> list[_Row]:
    """Of what remembers, where all have it."""
    if not all(m.state and m.state_object for m in measurements):
        return []
    name = measurements[0].name
    return [
        (
            f"`{name}_state.o`: text, data, bss [B]",
            lambda m: _sizes(m.state_object) if m.state_object else "",
        ),
        (
            f"`{name}_state_update`: instructions, mean, median, most",
            lambda m: _instructions(m.state) if m.state else "",
        ),
        (f"`{name}_state_update`: stack, median and most [B]", lambda m: _stack(m.state) if m.state else ""),
    ]


def _sizes(sizes: Sizes) -> str:
    return f"{sizes.text:,}, {sizes.data:,}, {sizes.bss:,}"


def _if_cold(m: Measurement, told: Callable[[Cost], str]) -> str:
    return told(m.cold) if m.cold else "none"


def _instructions(cost: Cost) -> str:
    return f"{cost.instructions:,.0f}, {cost.median:,.0f}, {cost.most:,}"


def _stack(cost: Cost) -> str:
    return f"{cost.usual_stack:,}, {cost.stack:,}"


def _chain(chain: Chain) -> str:
    return f"{chain.size:,}: " + ", ".join(f"`{name}` {size:,}" for name, size in chain.frames)


def _errors(*costs: Cost) -> str:
    position, rotation = np.max([(cost.position, cost.rotation) for cost in costs], axis=0)  # NaN stays NaN
    return f"{position:.1e} mm, {rotation:.1e} rad"


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
