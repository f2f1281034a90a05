"""Why some parameters cannot be told: which chosen ones show like them, and what of them is left to see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.identification.identifiability.observability import Columns, independent_subset

from .campaign import Array, Campaign
from .fits import LEAST, all_columns

KAPPA = "platform-deformation@platform,form=1:K[{0},{0}]"


@dataclass(frozen=True)
class Sight:
    """How the readings see a ``step`` of a parameter: ``alone`` in sigmas, ``like`` so much of ``partner``.

    In sigmas too: what stays visible when the partner moves along (``apart``), and when all chosen parameters do
    (``left``). Steps: 1 mm; 0.01 of a direction or kappa; a tenth of a stiffness or beta.
    """

    name: str
    step: str
    partner: str
    alone: float
    like: float
    apart: float
    left: float


def sight(columns: Columns, name: str, partner: str, chosen: Sequence[str], label: str = "") -> Sight:
    """Of ``name`` beside ``partner``, and beside all that were chosen."""
    step, size = _step(columns, name)
    partner_step, partner_size = _step(columns, partner)
    per_unit = columns.factor / columns.scale
    column = size * per_unit[:, columns.names.index(name)]
    other = partner_size * per_unit[:, columns.names.index(partner)]
    like = float(other @ column / (other @ other))
    beside = columns.factor[:, [columns.names.index(n) for n in chosen if n != name]]
    left = column - beside @ np.linalg.lstsq(beside, column, rcond=None)[0]
    return Sight(
        f"{name}{label}",
        step,
        f"{like:.3g} x {partner_step} of {partner}",
        float(np.linalg.norm(column)),
        like,
        float(np.linalg.norm(column - like * other)),
        float(np.linalg.norm(left)),
    )


def _step(columns: Columns, name: str) -> tuple[str, float]:
    """A step in words and in units of the parameter."""
    if ".u." in name or "K[" in name:
        return "0.01", 0.01
    if name.startswith(("flexure.", "rod.")) or name.endswith(".beta"):
        return "10 %", float(columns.scale[columns.names.index(name)])
    return "1 mm", 1.0


def chosen_of(columns: Columns, *, without: str = "") -> tuple[str, ...]:
    """What the program chooses, all names with ``without`` in them held."""
    names = [k for k, name in enumerate(columns.names) if not without or without not in name]
    part = Columns(tuple(columns.names[k] for k in names), columns.factor[:, names], columns.scale[names])
    return independent_subset(part, least=LEAST).kept


def leg_sights(campaign: Campaign, leg: int) -> list[Sight]:
    """The report's three sentences for one leg, on the 6-PUS."""
    columns = all_columns(campaign, "spherical", full=False)
    chosen = chosen_of(columns, without="K[")
    length, kappa = f"leg{leg}.length", KAPPA.format(leg)
    seen = next(name for name in chosen if name.startswith(f"leg{leg}.u."))
    hidden = f"leg{leg}.u.{'y' if seen.endswith('x') else 'x'}"
    out = [sight(columns, f"leg{leg}.{name}", length, chosen) for name in ("a.z", "b.z", "offset")]
    return [*out, sight(columns, kappa, seen, chosen), sight(columns, hidden, seen, chosen)]


def flexure_sights(campaign: Campaign, leg: int) -> list[Sight]:
    """Flexure lengths, beta and stiffnesses, in the models that have them."""
    length, out = f"leg{leg}.length", []
    for model, names in (
        ("beam", (f"leg{leg}.flexure", f"leg{leg}.beta")),
        ("stiffness", (f"leg{leg}.flexure",)),
        (
            "elastic",
            (
                f"leg{leg}.flexure",
                "flexure.bending",
                "flexure.tension",
                "flexure.torsion",
                "rod.bending",
                "rod.tension",
                "rod.torsion",
            ),
        ),
    ):
        columns = all_columns(campaign, model, full=False)
        chosen = chosen_of(columns, without="K[")
        out += [sight(columns, name, length, chosen, f" ({model})") for name in names]
    return out


def pivots(columns: Columns) -> Array:
    """(rank,) what is new in each column as it is taken, sigmas a tolerance."""
    kept = independent_subset(columns).kept
    taken = columns.factor[:, [columns.names.index(name) for name in kept]]
    return np.asarray(np.abs(np.diag(np.linalg.qr(taken)[1])))


def counts(campaign: Campaign, model: str = "spherical") -> dict[str, int]:
    """How many parameters show: geometry, the full K, and both together."""
    columns = all_columns(campaign, model, full=True)
    bending = [name for name in columns.names if "K[" in name]
    return {
        "geometry": len(chosen_of(columns, without="K[")),
        "K": len(chosen_of(columns, without="leg")),
        "entries of K": len(bending),
        "geometry and K": len(chosen_of(columns)),
    }
