"""Whole files by another convention: SI throughout, odd units, scalar-first quaternions, another table of constants."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..pairs import ANGLES, TURNS, Pair
from .dh import WHERE
from .spoilt import Spoilt

GRADIANS = 10.0 / 9.0
FOOT, INCH, METRE = 1 / 304.8, 1 / 25.4, 1e-3


def turning(pair: Pair) -> list[str]:
    """Return the joints that turn."""
    return [name for name, kind in pair.joints.items() if kind == "revolute"]


def all_si(pair: Pair, rng: np.random.Generator) -> Spoilt:
    """m and rad in every column, under the headers of mm and deg."""
    document, table = pair.draft()
    angles = [*turning(pair), *(c for c in pair.readings if c in (*TURNS, *ANGLES))]
    lengths = [*(n for n in pair.joints if n not in angles), *pair.lengths]
    table[angles] = np.radians(table[angles])
    table[lengths] *= METRE
    return Spoilt("m and rad", document, table, (*angles, *lengths, "recording", "readings", "joints"))


def odd_unit(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Lengths in feet, or joints in gradians."""
    document, table = pair.draft()
    names = turning(pair)
    if rng.random() < 0.5 and names:
        table[names] *= GRADIANS
        return Spoilt("gradians", document, table, (*names, "joints"))
    if not pair.lengths:
        return None
    table[list(pair.lengths)] *= FOOT
    return Spoilt("feet", document, table, (*pair.lengths, "readings"))


def one_column(pair: Pair, rng: np.random.Generator) -> Spoilt:
    """One joint or one reading in another unit than its neighbours."""
    document, table = pair.draft()
    name = str(rng.choice([*pair.joints, *pair.readings]))
    is_angle = name in (*turning(pair), *TURNS, *ANGLES)
    factor = np.pi / 180 if is_angle else float(rng.choice([METRE, INCH]))
    table[name] *= factor
    return Spoilt(f"one column times {factor:.3g}", document, table, (name,))


def quaternion_order(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Quaternions w x y z that were read as x y z w."""
    if pair.sensor != "pose":
        return None
    document, table = pair.draft()
    right = Rotation.from_rotvec(np.radians(table[list(TURNS)].to_numpy())).as_quat(canonical=True)
    wrong = Rotation.from_quat(np.roll(right, 1, axis=1))
    table[list(TURNS)] = np.degrees(wrong.as_rotvec())
    return Spoilt("scalar first", document, table, (*TURNS, "rotations", "readings", "sensor"))


def table_rows(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Two neighbouring rows of the table change places; the joints keep their names."""
    if pair.form != "serial":
        return None
    document, table = pair.draft()
    rows = document["mechanism"]["joints"]
    k = int(rng.integers(len(rows) - 1))
    fields = ("beta", "alpha", "d", "theta", "r")
    one, other = ({f: row[f] for f in fields} for row in rows[k : k + 2])
    if rows[k]["kind"] != rows[k + 1]["kind"]:
        return None
    rows[k].update(other)
    rows[k + 1].update(one)
    return Spoilt("rows exchanged", document, table, (*WHERE, rows[k]["name"], rows[k + 1]["name"]))


def table_stated(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """A modified table under ``convention: standard``."""
    if pair.form != "serial" or any(row["beta"] for row in pair.document["mechanism"]["joints"]):
        return None
    document, table = pair.draft()
    mechanism = document["mechanism"]
    for row in mechanism["joints"]:
        del row["beta"]
        row["a"], row["d"] = row.pop("d"), row.pop("r")
    document["mechanism"] = {"type": "serial", "convention": "standard", "joints": mechanism["joints"]}
    return Spoilt("modified stated as standard", document, table, (*WHERE, *pair.joints))
