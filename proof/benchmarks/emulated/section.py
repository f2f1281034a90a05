"""Measurements as a table in Markdown."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from emulated.measure import Chain, Cost, Measurement
from emulated.program import Sizes

_Row = tuple[str, Callable[[Measurement], str]]


def table(measurements: Sequence[Measurement]) -> list[str]:
    """Lines of a Markdown table, a column a measurement."""
    heads = [f"{m.target.title}, `{m.optimisation}`" for m in measurements]
    lines = ["| | " + " | ".join(heads) + " |", "|---|" + "---|" * len(heads)]
    for title, cell in [*_rows(measurements[0].name), *(_state_rows(measurements))]:
        lines.append(f"| {title} | " + " | ".join(cell(m) for m in measurements) + " |")
    return lines


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
