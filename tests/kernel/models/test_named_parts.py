"""Names in a machine file: places of effects, tolerances of parameters, bodies of masses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support.moving_machines import ARM, FRAMED, POSE, PUS, written
from truepose.errors import InputError
from truepose.models.machine.mechanism import AXES


def effect_entry(slug: str, *places: str) -> str:
    return f"effects:\n  - {{effect: {slug}, place: [{', '.join(places)}], parameters: {{}}}}\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (effect_entry("actuator-scale", "rho9"), r"effects\[0\]\.place: found \['rho9'\]"),
        (
            effect_entry("zero-shift", "rho1", "rho2", "rho3"),
            r"effects\[0\]\.place: found \['rho1', 'rho2', 'rho3'\]",
        ),
        (effect_entry("axis-coupling", "rho1"), r"effects\[0\]\.place: found \['rho1'\]"),
    ],
)
def test_places_nobody_knows_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        written(tmp_path, FRAMED + PUS + POSE + text)


def test_a_tolerance_without_a_name_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"m\.yaml: tolerances\.: no such parameter"):
        written(tmp_path, PUS.replace("gain: 0.001", '"": 0.5') + POSE)


def test_a_tolerance_of_a_frame_may_stand_with_the_others(tmp_path: Path) -> None:
    machine = written(tmp_path, FRAMED + PUS.replace("gain: 0.001", "base.xyz: 7, tool.rx: 2") + POSE)
    assert [machine.geometry[f"base.{axis}"].tolerance for axis in AXES[:4]] == [7.0] * 3 + [np.radians(1.0)]
    assert machine.geometry["tool.rx"].tolerance == pytest.approx(np.radians(2.0))


@pytest.mark.parametrize(("body", "known"), [("flange", True), ("link3", True), ("lnik3", False)])
def test_masses_hang_on_bodies_there_are(tmp_path: Path, body: str, known: bool) -> None:
    text = ARM.replace("in: link2", f"in: {body}") + POSE
    if known:
        assert written(tmp_path, text).masses[0].body == {"flange": "link6"}.get(body, body)
        return
    with pytest.raises(InputError, match=r"masses\.upper\.in: found 'lnik3'.*'link3'"):
        written(tmp_path, text)


def test_an_effect_stands_once_at_a_place_with_its_settings(tmp_path: Path) -> None:
    """Twice it would be two constants of one name; another order is another effect."""
    one = "{effect: encoder-eccentricity, place: [q1], order: 1, parameters: {}}"
    text = ARM + POSE + f"effects: [{one}, {one.replace('order: 1', 'order: 2')}]\n"
    assert len(written(tmp_path, text).effects) == 2
    with pytest.raises(
        InputError, match=r"effects\[1\]: found encoder-eccentricity@q1,order=1, which is effects\[0\]"
    ):
        written(tmp_path, text.replace("order: 2", "order: 1"))
