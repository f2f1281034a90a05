"""``offset`` are the zeros of all joints, whatever each is called in its mechanism: fitted alone, they alone move."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from support.simulated import machine_from
from truepose.api import calibrate
from truepose.models.machine.machine import Machine

SLIDES = [
    {"name": "A", "kind": "prismatic", "r": 100.0},
    {"name": "B", "kind": "prismatic", "alpha": 90, "r": 50.0},
    {"name": "C", "kind": "prismatic", "beta": 90, "r": 20.0},
]
GRAPH = [
    {"name": name, "kind": "prismatic", "parent": parent, "child": child, "axis": axis, "actuated": True}
    for name, parent, child, axis in zip(
        "ABC", ["base", "b", "c"], ["b", "c", "d"], np.eye(3).astype(int).tolist(), strict=True
    )
]
MECHANISMS: dict[str, dict[str, object]] = {
    "serial": {"type": "serial", "joints": SLIDES},
    "graph": {"type": "graph", "bodies": ["base", "b", "c", "d"], "joints": GRAPH},
}


def loaded(folder: Path, kind: str) -> Machine:
    document = {
        "schema": "truepose/machine/1",
        "name": "slides",
        "mechanism": MECHANISMS[kind],
        "sensor": {"type": "position", "sigma": {"xyz": 0.001}},
        "tolerances": {"length": 1.0, "angle": 0.1},
    }
    return machine_from(folder, yaml.safe_dump(document), "slides")


@pytest.mark.parametrize(("kind", "zero"), [("serial", "r"), ("graph", "offset")])
@pytest.mark.parametrize("joint", ["", "A."])
def test_zeros_alone_are_fitted(tmp_path: Path, kind: str, zero: str, joint: str) -> None:
    machine = loaded(tmp_path, kind)
    q = np.random.default_rng(0).uniform(-50, 50, (10, 3))
    names = ["A"] if joint else ["A", "B", "C"]
    off = dict(zip(names, [0.5, -0.3, 0.2], strict=False))
    rows = dict(zip("ABC", q.T, strict=True))
    shifted = {name: values + off.get(name, 0.0) for name, values in rows.items()}
    readings = dict(zip("xyz", _places(kind, shifted).T, strict=True))
    found = calibrate(machine, {**rows, **readings}, only=(f"{joint}offset",)).machine
    drawn, moved = ({p.name: p.nominal for p in m.parameters} for m in (machine, found))
    changed = {name: moved[name] - value for name, value in drawn.items() if abs(moved[name] - value) > 1e-9}
    assert changed == pytest.approx({f"{name}.{zero}": off[name] for name in names}, abs=1e-3)


def _places(kind: str, q: dict[str, np.ndarray]) -> np.ndarray:
    """(n, 3) where three slides along their drawn axes put the tool."""
    if kind == "graph":
        return np.column_stack([q["A"], q["B"], q["C"]])
    return np.column_stack([q["C"] + 20.0, -(q["B"] + 50.0), q["A"] + 100.0])
