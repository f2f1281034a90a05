"""Joints give way along gravity: which way it is stated is told by them alone, where they can be seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import truepose
from support.checked_arm import JOINTS, document, recorded, written
from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.result import Found
from truepose.identification.leaves.check.run import check_loaded

DOWN, UP = [0.0, 0.0, -9.80665], [0.0, 0.0, 9.80665]
MASSES = {
    "upper": {"kg": 30.0, "com": [-200.0, 0.0, 0.0], "in": "link2"},
    "forearm": {"kg": 20.0, "com": [0.0, 0.0, 100.0], "in": "link4"},
}
SEEN, UNSEEN = 6e-6, 1e-8
"""Compliances, rad/(N m), that move the tool by tens of the sensor's sigmas, and by far less than one."""


def effect(slug: str, joint: str, unit: str, **values: float) -> dict[str, Any]:
    return {
        "effect": slug,
        "place": [joint],
        "parameters": {name: {"value": value, "unit": unit} for name, value in values.items()},
    }


def found_by(
    folder: Path,
    stated: list[float],
    *effects: dict[str, Any],
    pulls: list[float] = DOWN,
    rows: int = 45,
    **more: Any,
) -> list[Found]:
    """What is said of gravity where an arm with these effects is pulled elsewhere than stated, perhaps."""
    q = recorded()[list(JOINTS)][:rows].reset_index(drop=True)
    built = document(masses=MASSES, gravity=pulls, effects=list(effects))
    real = truepose.load_machine(written(folder, built, q)[0])
    both = pd.concat([q, truepose.simulate(real, q, seed=4).reset_index(drop=True)], axis=1)
    drawn = document(**{"masses": MASSES, "gravity": stated, **more})
    machine = truepose.load_machine(written(folder, drawn, both)[0])
    found = check_loaded(machine, truepose.load_recording(machine, both)).found
    return [one for one in found if one.kind == "gravity-reversed"]


def compliant(size: float) -> list[dict[str, Any]]:
    return [effect("joint-compliance", f"q{k}", "rad/(N*m)", c=size) for k in (2, 3)]


@pytest.mark.parametrize(("down", "up"), [(DOWN, UP), (UP, DOWN), ([9.8, 0.0, 0.0], [-9.8, 0.0, 0.0])])
@pytest.mark.parametrize("masses", [MASSES, None])
def test_gravity_with_the_other_sign_is_told_and_mended(
    down: list[float], up: list[float], masses: dict[str, Any] | None, tmp_path: Path
) -> None:
    (found,) = found_by(tmp_path, up, *compliant(SEEN), pulls=down, masses=masses)
    assert found.verdict == "suspect" and found.where == ("gravity",) and found.mend is not None
    mended = found.mend(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"]))
    assert mended.get(("gravity",)) == down
    assert found_by(tmp_path, down, *compliant(SEEN), pulls=down, masses=masses) == []


@settings(max_examples=8, deadline=None)
@given(data=st.data())
def test_no_encoder_makes_gravity_look_reversed(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    sizes = st.floats(-1e-3, 1e-3)
    eccentric = [
        effect("encoder-eccentricity", name, "rad", a=data.draw(sizes), b=data.draw(sizes))
        for name in JOINTS[1:3]
    ]
    compliance = data.draw(st.sampled_from([0.0, UNSEEN, SEEN]))
    assert found_by(tmp_path_factory.mktemp("arm"), DOWN, *eccentric, *compliant(compliance)) == []


@pytest.mark.parametrize(
    ("size", "rows", "more"),
    [(UNSEEN, 45, {}), (SEEN, 5, {}), (SEEN, 45, {"effects": compliant(SEEN)})],
)
def test_nothing_is_told_where_nothing_gives_way_that_can_be_seen(
    size: float, rows: int, more: dict[str, Any], tmp_path: Path
) -> None:
    assert found_by(tmp_path, UP, *compliant(size), rows=rows, **more) == []
