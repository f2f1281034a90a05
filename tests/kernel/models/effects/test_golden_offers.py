"""What each effect offers on machines of every kind: places, settings, how likely, what is fitted in which bounds, its words.

A change of it shows as a change of ``tests/golden_offers``. After one that is meant:

    pytest tests/kernel/models/effects/test_golden_offers.py --update-golden

writes them anew; what then differs is for the reviewer.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import inf
from typing import TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray

from support import TESTS
from support.effect_machines import READINGS, Machines
from support.effects import Campaign, Solved
from support.golden_pages import as_committed
from truepose.models.effects.base import Effect, Place, PlacedEffect, Settings, effects
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
T = TypeVar("T")
TIME = np.linspace(0.0, 7200.0, 50)
ELSEWHERE: Mapping[str, Array] = {
    "time": TIME,
    "temperature.hall": 20.0 + TIME / 3600.0,
    "temperature.floor": 21.0 + np.sin(TIME / 1000.0),
    "pressure": 1000.0 + np.cos(TIME / 2000.0),
}
"""What was logged of other places; the air was not."""


class Varied(Campaign):
    """Two hours in three sessions, in which all that was logged varies."""

    def driver(self, name: str) -> object | None:
        found = super().driver(name)
        return found if found is None or name == "time" else np.linspace(-1.0, 25.0, 5)


def ends(items: Sequence[T], most: int = 2) -> list[T]:
    """The first ones and the last of many."""
    return [*items[:most], *([items[-1]] if len(items) > most else [])]


def term(effect: Effect, machine: Machine, place: Place, settings: Settings) -> Iterator[str]:
    """Lines on one term: how likely it is, what is fitted, and what is said of it."""
    placed = PlacedEffect.at(effect, machine, place, settings)
    likely = effect.weight(settings) * effect.likely(machine, place)
    facts = [f"likely {likely:.4g}", f"as {placed.kind}", *(["load"] if placed.needs_load else [])]
    facts += ["unlooked for"] * (not effect.screened(machine, place)) + ["borrows"] * placed.borrows
    facts += [f"twin {name} {share:.3g}" for name, share in placed.twins.items()]
    facts += ["adds"] * effect.adds(settings)
    yield f"  {placed.label}: {', '.join(facts)}; reads {', '.join(placed.drivers) or 'nothing'}"
    for c in ends(placed.coefficients, 3):
        bounds = "" if (c.lower, c.upper) == (-inf, inf) else f" in {c.lower:.4g} to {c.upper:.4g}"
        yield f"    {c.name} of {len(placed.coefficients)}: {c.scale:.4g} {c.unit}{bounds}"
    yield f"    {effect.explain(machine, place, settings)}"
    values = {c.name: c.scale * (0.7 + 0.2 * (k % 3)) for k, c in enumerate(placed.coefficients)}
    for share in (0.01, 0.6):
        said = effect.found(values, {name: share * abs(value) for name, value in values.items()})
        if said:
            yield f"    {share:g}: {said}"
    seen = dict.fromkeys(machine.mechanism.readings, (-0.3, 0.5))
    within = effect.within(place, settings, seen)
    if within != settings:
        yield f"    within {', '.join(f'{name} {value:.4g}' for name, value in sorted(within.items()))}"


def offers(machine: Machine) -> Iterator[str]:
    """Lines on all effects of a machine: of its first and last place, of the first and last settings."""
    for slug in effects:
        effect = effects.get(slug, "test")()
        places = [tuple(place) for place in effect.places(machine)]
        if not places:
            continue
        yield f"{slug}: {len(places)} places, {'+'.join(places[0])} to {'+'.join(places[-1])}"
        for place in dict.fromkeys((places[0], places[-1])):
            tried = list(effect.settings(machine, place, Varied()))
            other = list(effect.elsewhere(machine, place, ELSEWHERE))
            yield f"  {'+'.join(place)}: {len(tried)} settings, {len(other)} that read elsewhere"
            for settings in (*ends(tried), *ends(other, 1)):
                yield from term(effect, machine, place, settings)


def signatures(machine: Machine, q: Sequence[float]) -> Iterator[str]:
    """Lines on what each coefficient moves at the tool and in the readings, all effects standing at their first place."""
    placed = []
    for slug in effects:
        effect = effects.get(slug, "test")()
        for place in list(effect.places(machine))[:1]:
            tried = list(effect.settings(machine, tuple(place), Varied()))
            placed += [
                PlacedEffect.at(effect, machine, tuple(place), settings) for settings in ends(tried, 1)
            ]
    # no whole numbers, or a product would be a quotient
    solved = Solved(symbolic_model(machine, tuple(placed)), q, session=0.8, approach=-0.7)
    names = solved.model.names
    for one in placed:
        for c, name in ends(list(zip(one.coefficients, one.parameter_names, strict=True)), 3):
            moved = c.scale * solved.jacobian[:, names.index(name)]
            told = " ".join(
                f"{v:.3e}" if abs(v) > max(1e-7 * np.abs(moved).max(), 1e-11) else "0" for v in moved
            )
            yield f"{name}: {told}"


@pytest.mark.parametrize("name", READINGS)
def test_what_effects_offer_is_as_committed(
    name: str, machines: Machines, request: pytest.FixtureRequest
) -> None:
    """Whoever reads a diagnosis relies on what was looked for, in which bounds, and on the words."""
    update = bool(request.config.getoption("--update-golden"))
    file, made = TESTS / "golden_offers" / f"{name}.txt", list(offers(machines[name]))
    if update:
        file.write_text("\n".join([*made, ""]), encoding="utf-8")
    assert (
        made == file.read_text(encoding="utf-8").splitlines()
    )  # few digits of plain numbers: the same everywhere


@pytest.mark.parametrize("name", READINGS)
def test_what_effects_move_is_as_committed(
    name: str, machines: Machines, request: pytest.FixtureRequest
) -> None:
    """Whose values a machine file of last year states: they must mean the same today."""
    update = bool(request.config.getoption("--update-golden"))
    made = list(signatures(machines[name], READINGS[name]))
    as_committed(TESTS / "golden_offers" / f"{name}_moves.txt", made, update=update)
