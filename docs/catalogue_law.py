"""What an effect's own formula adds on a small machine, for the curves of the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Final

import casadi as ca
import numpy as np

from catalogue_canvas import Array
from truepose.models.load import load_machine
from truepose.models.machine.effect import Site, effects
from truepose.models.machine.machine import Machine

MACHINE: Final = Path(__file__).resolve().parent / "catalogue_machine.yaml"


class _Symbols(dict[str, ca.SX]):
    """Symbols that come into being when they are asked for."""

    def __missing__(self, name: str) -> ca.SX:
        self[name] = ca.SX.sym(name)
        return self[name]


@cache
def machine() -> Machine:
    """A slide with a turning joint, seen by a camera and an interferometer."""
    return load_machine(MACHINE)


def law(
    slug: str,
    place: str,
    values: Mapping[str, float],
    at: Mapping[str, Array],
    *,
    settings: Mapping[str, float] | None = None,
    port: str = "",
) -> Array:
    """(n,) what an effect adds at a port (the only one unless named), where readings, drivers and columns are ``at``."""
    effect = effects.get(slug, "drawing")()
    small, known = machine(), dict(settings or {})
    symbols = _Symbols()
    names = [c.name for c in effect.coefficients(small, (place,), known)]
    nominal = {name: ca.SX(0) for name in small.ports} | {
        n: ca.SX(p.nominal) for n, p in small.geometry.items()
    }
    site = Site(
        small,
        (place,),
        known,
        {n: ca.SX(values.get(n, 0.0)) for n in names},
        symbols,
        symbols,
        nominal,
        symbols,
        symbols,
    )
    shifts = effect.shifts(site)
    shift = shifts[port] if port else next(iter(shifts.values()))
    n = len(next(iter(at.values())))
    inputs = [np.asarray(at.get(name, np.zeros(n)), dtype=float) for name in symbols]
    function = ca.Function("shift", list(symbols.values()), [ca.SX(shift)])
    return np.asarray(function.map(n)(*(v[None, :] for v in inputs)), dtype=float).ravel()
