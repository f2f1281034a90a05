"""Columns of joints that run the other way, stand for one another, or count from another zero; and swapped readings."""

from __future__ import annotations

import numpy as np

from ..pairs import Pair
from .spoilt import Spoilt

ROUND = (90.0, -90.0, 180.0)
SMALLEST = 12.0
"""deg of a zero that was never set."""


def sign(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """One joint that passes through zero counts the other way."""
    through = [name for name in pair.joints if pair.table[name].min() < 0 < pair.table[name].max()]
    if not through:
        return None
    name = str(rng.choice(through))
    document, table = pair.draft()
    table[name] = -table[name]
    return Spoilt(f"-{name}", document, table, (name,))


def permutation(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Two joints, two axes of the readings or two targets change places."""
    options = [_joints]
    if pair.points:
        options.append(_axes)
    if len(pair.points) > 1:
        options.append(_targets)
    return options[int(rng.integers(len(options)))](pair, rng)


def _joints(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    kinds = list(pair.joints.items())
    alike = [(a, b) for k, (a, x) in enumerate(kinds) for b, y in kinds[k + 1 :] if x == y]
    if not alike:
        return None
    one, other = alike[int(rng.integers(len(alike)))]
    document, table = pair.draft()
    table[one], table[other] = pair.table[other], pair.table[one]
    return Spoilt("two joints", document, table, (one, other))


def _axes(pair: Pair, rng: np.random.Generator) -> Spoilt:
    """A swap mirrors; where the base may stand anywhere, any left-handed frame says as much."""
    one, other = sorted(rng.permutation(3)[:2].tolist())
    document, table = pair.draft()
    for point in pair.points:
        table[point[one]], table[point[other]] = pair.table[point[other]], pair.table[point[one]]
    names = ("xyz"[one], "xyz"[other])
    columns = tuple(p[k] for p in pair.points for k in (one, other))
    unknown = not np.isfinite(document["frames"]["base"]["tolerance"]["rpy"])
    return Spoilt("two axes", document, table, (*names, *columns), kinds=("handedness",) if unknown else ())


def _targets(pair: Pair, rng: np.random.Generator) -> Spoilt:
    names = list(pair.document["sensor"]["points"])
    one, other = (names[int(k)] for k in rng.permutation(len(names))[:2])
    document, table = pair.draft()
    for axis in "xyz":
        table[f"{one}.{axis}"] = pair.table[f"{other}.{axis}"]
        table[f"{other}.{axis}"] = pair.table[f"{one}.{axis}"]
    return Spoilt("two targets", document, table, (one, other))


def offset(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """A joint off by 90 or 180 deg, by a zero that was never set, or without the ``theta`` of its row."""
    names = list(pair.joints)
    name = str(rng.choice(names))
    document, table = pair.draft()
    if pair.form == "serial" and rng.random() < 0.3:
        rows = [j for j in document["mechanism"]["joints"] if j.get("theta") and j["kind"] == "revolute"]
        if rows:
            row = rows[int(rng.integers(len(rows)))]
            row["theta"] = 0.0
            return Spoilt("theta forgotten", document, table, (row["name"],))
    if pair.joints[name] == "prismatic":
        span = float(np.ptp(pair.table[name])) or 1.0
        table[name] += rng.choice([-1, 1]) * rng.uniform(0.15, 0.8) * span
        return Spoilt("zero of a slide", document, table, (name,))
    if rng.random() < 0.5:
        by, variant = float(rng.choice(ROUND)), "90 or 180 deg"
    else:
        by, variant = float(rng.choice([-1, 1]) * rng.uniform(SMALLEST, 170.0)), "zero never set"
    table[name] += by
    if rng.random() < 0.4:
        table[name] = (table[name] + 180.0) % 360.0 - 180.0
    return Spoilt(variant, document, table, (name,))


def order(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Joints logged in another order: from the tool to the base, or from the second joint on."""
    kinds = set(pair.joints.values())
    if len(kinds) > 1 or len(pair.joints) < 3:
        return None
    names = list(pair.joints)
    other = names[::-1] if rng.random() < 0.5 else [*names[1:], names[0]]
    document, table = pair.draft()
    table[names] = pair.table[other].to_numpy()
    return Spoilt(f"columns hold {', '.join(other)}", document, table, tuple(names))


def signs(pair: Pair, rng: np.random.Generator) -> Spoilt:
    """Several joints count the other way, or all."""
    names = list(pair.joints)
    chosen = names if rng.random() < 0.3 else [names[k] for k in sorted(rng.permutation(len(names))[:2])]
    document, table = pair.draft()
    table[chosen] = -table[chosen]
    return Spoilt(f"-{', -'.join(chosen)}", document, table, tuple(chosen))
