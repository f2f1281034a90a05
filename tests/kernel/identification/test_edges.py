"""Machines at the edge of what can be calibrated: told in other units, in another order or from another base they give the
same answer, or are refused in the same words."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from support.told_otherwise import (
    BASE,
    OTHERWISE,
    TOOL,
    Case,
    Document,
    apart,
    recorded,
)
from truepose.errors import TrueposeError
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.estimated import Estimate

ROWS = 30


def _joint(name: str, kind: str = "revolute", half: float = 80.0, **constants: float) -> Document:
    return {"name": name, "kind": kind, **constants, "range": [-half, half]}


@dataclass(frozen=True)
class Edge:
    """A chain of joints, the sensor's sigma (mm, deg), tolerances, and which poses are measured; ``same``: how nearly
    alike answers must be, of a parameter or its tolerance: where a sigma is near rounding, so are they."""

    joints: tuple[Document, ...]
    sigma: float = 0.01
    tolerances: tuple[float, float] = (0.2, 0.1)
    poses: Callable[[pd.DataFrame], pd.DataFrame] = lambda table: table
    same: float = 1e-7

    @property
    def document(self) -> Document:
        """Its machine file."""
        length, angle = self.tolerances
        return {
            "schema": "truepose/machine/1",
            "name": "edge",
            "mechanism": {"type": "serial", "joints": [dict(joint) for joint in self.joints]},
            "frames": {"base": {**BASE}, "tool": {**TOOL}},
            "sensor": {"type": "pose", "sigma": {"xyz": self.sigma, "rot": self.sigma / 2}},
            "tolerances": {"length": length, "angle": angle},
        }


ARM = (_joint("q1", r=200.0), _joint("q2", alpha=90.0, d=40.0), _joint("q3", d=300.0))
EDGES: Mapping[str, Edge] = {
    "parallel axes": Edge((_joint("q1", d=0.0), _joint("q2", d=300.0), _joint("q3", d=250.0), _joint("q4", d=10.0))),
    "nearly parallel axes": Edge((_joint("q1"), _joint("q2", d=300.0, alpha=1e-6), _joint("q3", d=250.0, alpha=-1e-7))),
    "a joint that never moves": Edge(ARM, poses=lambda t: t.assign(q2=12.5)),
    "a joint locked by its range": Edge((*ARM[:2], {**ARM[2], "range": [29.999, 30.001]})),
    "always stretched out": Edge((*ARM[:2], {**ARM[2], "range": [-1e-6, 1e-6]})),
    "one joint": Edge((_joint("q1", r=50.0),)),
    "one slide": Edge((_joint("q1", "prismatic", 100.0),)),
    "twelve joints": Edge(tuple(_joint(f"q{k}", alpha=90.0 * (-1) ** k, d=60.0 + 7 * k, r=11.0 * k) for k in range(1, 13))),
    "microns beside kilometres": Edge(
        (_joint("q1", r=2e6), _joint("q2", "prismatic", 0.005, alpha=90.0), _joint("q3", d=1e-3)), same=1e-4
    ),
    "a sigma of 1e-9": Edge(ARM, sigma=1e-9, same=1e-4),
    "a sigma of 1e3": Edge(ARM, sigma=1e3),
    "as many readings as constants": Edge(ARM, poses=lambda t: t.iloc[:5]),
    "one pose again and again": Edge(ARM, poses=lambda t: t.assign(q1=10.0, q2=20.0, q3=30.0)),
}  # fmt: skip


def answer(case: Case, folder: Path) -> Estimate | str:
    """A calibration, or the words that refuse it, without numbers."""
    try:
        return calibrate(*case.loaded(folder)).fit
    except TrueposeError as exc:
        return re.sub(r"[-+]?[0-9.]+(e[-+]?[0-9]+)?", "#", str(exc))


@pytest.mark.parametrize("name", EDGES)
def test_the_answer_does_not_depend_on_how_it_is_told(tmp_path: Path, name: str) -> None:
    edge = EDGES[name]
    case = recorded(edge.document, tmp_path, ROWS, poses_of=edge.poses)
    plain = answer(case, tmp_path)
    for what, tell in OTHERWISE.items():
        told: Any = answer(tell(case), tmp_path)
        if isinstance(plain, str):
            assert told == plain, what
        else:
            assert not isinstance(told, str), told
            assert apart(plain, told) < edge.same, what
            assert told.chi2 == pytest.approx(plain.chi2, rel=max(1e-6, edge.same), abs=1e-6), what
    if not isinstance(plain, str):
        assert np.isfinite(plain.p).all() and np.isfinite(plain.std[plain.prior.free]).all()
