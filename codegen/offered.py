"""What the templates read of features: which there are, built-in parameters, and what is remembered."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from truepose.codegen.blocks import Blocks
from truepose.codegen.features import Features
from truepose.codegen.layout import Layout
from truepose.codegen.memory import memory_of
from truepose.codegen.names import identifiers
from truepose.models.machine.kinematics import SymbolicModel


def offered(
    features: Features, model: SymbolicModel, layout: Layout, blocks: Blocks, ideal: list[float]
) -> dict[str, Any]:
    """What the templates read of features, of what is remembered, and the tables of built-in parameters."""
    return {
        "has": features,
        "rare": "RARE" if features.listed else "APART",
        "reads_p": any(re.search(r"\bp\b", text) for text in blocks.texts[1:]) or "p[" in blocks.texts[0],
        "settled": [] if features.p else blocks.settled(model.p_home.tolist()),
        "drawn_settled": [] if features.p else blocks.settled(ideal),
        **_memory(model, layout, features),
    }


def _memory(model: SymbolicModel, layout: Layout, features: Features) -> dict[str, Any]:
    """What the templates of ``NAME_state`` read: where drivers remember, or where it was asked for."""
    memory = memory_of(model, layout)
    if not features.state or not (memory.remembers or features.listed):
        return {"memory": None}
    rows = zip(model.drivers, driver_units(model), memory.places, strict=True)
    followed = [(name, unit) for name, unit, place in rows if place >= len(memory.sensed)]
    return {
        "memory": memory,
        "followed": entries([n for n, _ in followed], [unit for _, unit in followed]),
        "sensed": entries([n for n, _, _ in memory.sensed], [unit for _, unit, _ in memory.sensed]),
        "fields": [field for field in memory.fields if field.size],
    }


def entries(names: Sequence[str], units: Sequence[str]) -> list[dict[str, str]]:
    """Names with identifiers and units, for lists of places."""
    rows = zip(names, identifiers(names), units, strict=True)
    return [{"name": name, "identifier": identifier, "unit": unit} for name, identifier, unit in rows]


def driver_units(model: SymbolicModel) -> list[str]:
    """Units of a model's drivers, "1" where nobody knows."""
    return [model.machine.driver_unit(name) or "1" for name in model.drivers]
