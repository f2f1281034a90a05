"""Formulas of what a finding adds, in symbols: they are the effects' own, their terms add up, and say what else they read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import casadi as ca
import numpy as np
import pytest

from support.effect_machines import STAGE, read_machines
from support.effects import with_effect
from support.exact_fits import formula_of, posed
from support.moving_machines import written
from support.reports import gear_finding
from truepose.arrays import Array
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.report.formulas import Formula, coupling_matrix, formula, terms_of
from truepose.models.effects.base import PlacedEffect, Site
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.getbasetemp() / "formulas")


def made(machine: Machine, terms: Sequence[PlacedEffect]) -> Formula:
    found = formula(machine, terms)
    assert found is not None
    return found


def values(found: Formula, q: Array) -> dict[str, Array]:
    """(n,) of each port at readings q (n, nq)."""
    inputs = [ca.vertcat(*found.q.values()), found.coefficients]
    out = {}
    for port, shift in found.shifts.items():
        at = ca.Function("at", inputs, [shift])
        out[port] = np.array([float(at(row, found.amplitudes)) for row in q])
    return out


def test_a_formula_is_the_effect_s_own_at_every_reading(machines: Mapping[str, Machine]) -> None:
    """Two terms at a joint add up at its port; a third has a port of its own."""
    machine = machines["arm"]
    terms = [
        with_effect(machine, "transmission-error", ("q1",), {"order": 3.0}, a=3e-4, b=-1e-4),
        with_effect(machine, "transmission-error", ("q1",), {"order": 1.0}, a=-2e-4, b=4e-4),
        with_effect(machine, "encoder-eccentricity", ("q2",), {}, a=1e-4, b=2e-4),
    ]
    recording = posed(machine, 7)
    found = made(machine, terms)
    assert found.plain and list(found.q) == list(machine.mechanism.readings)
    assert found.amplitudes.tolist() == [a for term in terms for a in term.amplitudes]
    for port, expected in formula_of(machine, recording, terms).items():
        np.testing.assert_allclose(values(found, recording.q)[port], expected, atol=1e-15)
    alone = [values(made(machine, [term]), recording.q) for term in terms]
    both = values(found, recording.q)["q1.displacement"]
    np.testing.assert_allclose(both, alone[0]["q1.displacement"] + alone[1]["q1.displacement"], atol=1e-15)
    assert formula(machine, []) is None


@pytest.mark.parametrize(
    ("name", "slug", "place", "settings", "amplitudes", "plain"),
    [
        ("arm", "transmission-error", ("q1",), {"order": 3.0}, {"a": 3e-4, "b": -1e-4}, True),
        ("arm", "axis-wobble", ("q1",), {}, {"a": 2e-4, "b": 1e-4}, True),
        ("arm", "joint-compliance", ("q2",), {}, {"c": 2e-6}, False),  # reads a load
        ("arm", "thermal-expansion", ("link2",), {"lag": 0.0}, {"alpha": 2e-5}, False),  # reads a temperature
        ("arm", "sensor-scale", ("sensor",), {}, {"s": 5e-5}, False),  # reads what is seen
        ("arm", "backlash", ("q1",), {}, {"b": 1e-4}, False),  # reads the side of arrival
    ],
)
def test_plain_is_what_reads_nothing_but_joints(
    machines: Mapping[str, Machine],
    name: str,
    slug: str,
    place: tuple[str, ...],
    settings: dict[str, float],
    amplitudes: dict[str, float],
    plain: bool,
) -> None:
    term = with_effect(machines[name], slug, place, settings, **amplitudes)
    assert made(machines[name], [term]).plain is plain


def told(machine: Machine, *terms: PlacedEffect) -> Diagnosis:
    return cast(Diagnosis, SimpleNamespace(nominal=machine, terms=terms))


def test_a_finding_gathers_the_terms_of_its_effect_at_its_place(machines: Mapping[str, Machine]) -> None:
    machine = machines["arm"]
    one, two = (
        with_effect(machine, "transmission-error", ("q1",), {"order": order}, a=3e-4, b=-1e-4)
        for order in (1.0, 3.0)
    )
    elsewhere = with_effect(machine, "transmission-error", ("q2",), {"order": 1.0}, a=3e-4, b=-1e-4)
    other = with_effect(machine, "encoder-eccentricity", ("q1",), {}, a=1e-4, b=2e-4)
    found = gear_finding()
    assert terms_of(told(machine, other, one, elsewhere, two), found) == [one, two]
    assert terms_of(told(machine, one, two), replace(found, place=("q3",))) == []


def bent(machine: Machine) -> Diagnosis:
    """A platform that bends as legs travel, each end by its own share."""
    bare = with_effect(machine, "platform-deformation", ("platform",), {"form": 1.0})
    kappa = dict(zip([c.name for c in bare.coefficients], np.arange(1.0, 7.0) * 1e-3, strict=True))
    term = with_effect(machine, "platform-deformation", ("platform",), {"form": 1.0}, **kappa)
    return told(machine, term)


def test_a_matrix_of_what_each_joint_moves_where(machines: Mapping[str, Machine]) -> None:
    """By differences of the formula about the middle of the ranges; its rows are ports, its columns readings."""
    machine = machines["telescope"]
    diagnosis = bent(machine)
    finding = replace(gear_finding(), effect="platform-deformation", place=("platform",))
    found = coupling_matrix(diagnosis, finding)
    assert found is not None
    ports, slope = found
    own = made(machine, diagnosis.terms)
    middle = np.array([np.mean(a.range) if a.range else 0.0 for a in machine.mechanism.actuators])
    assert ports == list(own.shifts) and slope.shape == (len(ports), 6)
    step = 1e-3
    for k in range(6):
        ends = np.array([middle, middle])
        ends[:, k] += (-step, step)
        at = values(own, ends)
        np.testing.assert_allclose(
            slope[:, k], [np.diff(at[port])[0] / (2 * step) for port in ports], atol=1e-9
        )


def test_a_slope_that_varies_is_taken_at_the_middle_of_the_ranges(tmp_path: Path) -> None:
    """Two ports that move with powers of two joints, of -150 to 150 and -20 to 40 mm."""
    machine = written(tmp_path, STAGE)
    one, two = list(machine.ports)[:2]

    def powers(site: Site) -> dict[str, ca.SX]:
        return {one: site.c["a"] * (site.q["s1"] + 3.0) ** 2, two: site.c["a"] * site.q["s2"] ** 2}

    plain = {"place": ("s1",), "settings_map": {}, "drivers": (), "needs_load": False, "amplitudes": (2.0,)}
    named = (SimpleNamespace(name="a"),)
    term = SimpleNamespace(effect=SimpleNamespace(slug="bend", shifts=powers), coefficients=named, **plain)
    finding = replace(gear_finding(), effect="bend", place=("s1",))
    found = coupling_matrix(told(machine, cast(PlacedEffect, term)), finding)
    assert found is not None and found[0] == [one, two]
    np.testing.assert_allclose(found[1], [[2 * 2.0 * 3.0, 0.0, 0.0], [0.0, 2 * 2.0 * 10.0, 0.0]])


def test_there_is_no_matrix_of_one_port_or_of_one_joint(machines: Mapping[str, Machine]) -> None:
    """Nor of what reads anything else than joints, nor without terms."""
    machine = machines["arm"]
    for slug, place, settings, amplitudes in (
        ("transmission-error", ("q1",), {"order": 1.0}, {"a": 3e-4, "b": 1e-4}),
        ("axis-wobble", ("q1",), {}, {"a": 2e-4, "b": 1e-4}),
        ("sensor-scale", ("sensor",), {}, {"s": 5e-5}),
    ):
        term = with_effect(machine, slug, place, settings, **amplitudes)
        finding = replace(gear_finding(), effect=slug, place=place)
        assert coupling_matrix(told(machine, term), finding) is None
        assert coupling_matrix(told(machine), finding) is None
