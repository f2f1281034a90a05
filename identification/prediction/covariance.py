"""What a fit knows and does not know, in a form that a machine file can hold and a prediction can use.

C = F F' for the determined part, F lower triangular; directions that neither readings nor tolerances
determine are kept apart (``unknown``): as numbers of 1e30 they would drown all others. Internal units: mm,
rad and each effect's own.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.file.yaml_document import LongText
from truepose.models.machine.machine import Machine
from truepose.models.machine.seen import Range, read_ranges

Quantity = tuple[float, str]
"""A value in mm or rad, and which of the two."""
UNSEEN = 1e-6
"""A reading sees an unknown direction that moves it by more than this share of what single parameters do."""


MANY = 200
"""Names beyond which a factor is packed: nobody reads so many numbers, and every one of them is looked at by a parser."""
_FORM = "C = factor factor', factor lower triangular; mm, rad and each effect's own units"
_PACKED = "rows one after the other, packed: base64 of little-endian 32-bit floats"


@dataclass(frozen=True)
class Covariance:
    """Names of n estimates, a factor (n, n) F of their covariance F F', and directions (k, n) that are unknown.

    ``unexplained``: the model's own 1-sigma beside the sensors' (mm, rad), by sensor and kind of reading
    (``sensor.position``), where a fit left more than its sensors' noise. ``seen``: lowest and highest value of each joint
    (mm, rad) and driver of the effects in the fitted rows.
    """

    names: tuple[str, ...]
    factor: Array
    unknown: Array
    unexplained: Mapping[str, Quantity] = field(default_factory=dict)
    seen: Mapping[str, Range] = field(default_factory=dict)

    @classmethod
    def of(cls, names: Sequence[str], scale: Array, root: Array, unknown: Array) -> Covariance:
        """Covariance root root', ``root`` (n, m), and ``unknown`` directions (k, n), both in steps of ``scale`` (n,)."""
        triangle = np.asarray(np.linalg.qr(root.T * scale, mode="r")).T
        factor = np.zeros((len(names), len(names)))
        factor[:, : triangle.shape[1]] = triangle
        return cls(tuple(names), factor, unknown * scale)

    @classmethod
    def of_tolerances(cls, names: Sequence[str], sigma: Array) -> Covariance:
        """Independent entries of 1-sigma ``sigma`` (n,); where it is infinite, an entry is unknown."""
        finite = np.isfinite(sigma)
        return cls(tuple(names), np.diag(np.where(finite, sigma, 0.0)), np.eye(len(sigma))[~finite])

    def of_names(self, names: Sequence[str]) -> Covariance:
        """What it says of some of its names, the others being anything."""
        at = [self.names.index(name) for name in names]
        unknown = self.unknown[:, at]
        unknown = unknown[np.any(unknown != 0.0, axis=1)]
        own = Covariance.of(names, np.ones(len(at)), self.factor[at], unknown)
        return replace(own, unexplained=self.unexplained, seen=self.seen)

    def beside(self, other: Covariance) -> Covariance:
        """Both, as independent of each other; what is unexplained is this one's, what was seen is the other's."""
        n, m = len(self.names), len(other.names)
        factor, unknown = np.zeros((n + m, n + m)), np.zeros((len(self.unknown) + len(other.unknown), n + m))
        factor[:n, :n], factor[n:, n:] = self.factor, other.factor
        unknown[: len(self.unknown), :n], unknown[len(self.unknown) :, n:] = self.unknown, other.unknown
        return Covariance((*self.names, *other.names), factor, unknown, self.unexplained, other.seen)

    @classmethod
    def read(cls, section: Mapping[str, Any], where: str) -> Covariance:
        """From the section of a machine file. InputError when it is not what ``document`` writes."""
        try:
            names = tuple(str(name) for name in section["names"])
            factor, rows = _factor(section["factor"], len(names))
            unknown = np.array([str(row).split() for row in section.get("unknown", [])], dtype=float)
            unknown = unknown.reshape(len(unknown), len(names))
            items = section.get("unexplained", {}).items()
            own = {name: (float(item["value"]), str(item["unit"])) for name, item in items}
            seen = read_ranges(section.get("seen", {}), f"{where}.seen")
        except (AttributeError, KeyError, TypeError, ValueError, IndexError) as exc:
            raise InputError(
                f"{where}: found a covariance that cannot be read ({exc!r}), expected names and factor"
            ) from None
        if rows != len(names) or not np.isfinite(factor).all():
            raise InputError(f"{where}: found {rows} rows of factor, expected {len(names)} of finite numbers")
        for name, (value, unit) in own.items():
            if not 0.0 <= value < np.inf or unit not in ("mm", "rad"):
                raise InputError(
                    f"{where}.unexplained.{name}: found {value} {unit}, expected a number from 0 on in mm or rad"
                )
        return cls(names, factor, unknown, own, seen)

    def document(self) -> dict[str, Any]:
        """Names, rows of the lower triangle as text (packed, where they are many), unknown directions as text."""
        packed = len(self.names) > MANY
        rows = [] if packed else [_text(self.factor[k, : k + 1]) for k in range(len(self.names))]
        form = f"{_FORM}; {_PACKED}" if packed else _FORM
        factor = _packed(self.factor) if packed else rows
        out: dict[str, Any] = {"form": form, "names": list(self.names), "factor": factor}
        if len(self.unknown):
            out["unknown"] = [_text(row) for row in self.unknown]
        if self.unexplained:
            out["unexplained"] = {n: {"value": v, "unit": unit} for n, (v, unit) in self.unexplained.items()}
        if self.seen:
            out["seen"] = {name: [low, high] for name, (low, high) in self.seen.items()}
        return out

    def std(self, jacobian: Array, scale: Array) -> Array:
        """(...,) 1-sigma of quantities with derivative (..., n) by ``names``; inf where an unknown direction shows.

        ``scale`` (n,) is the size of a step of each entry.
        """
        out: Array = np.sqrt(np.sum((jacobian @ self.factor) ** 2, axis=-1))
        if len(self.unknown):
            size = np.linalg.norm(jacobian * scale, axis=-1)
            unit = self.unknown / np.linalg.norm(self.unknown / scale, axis=1)[:, None]
            seen = np.linalg.norm(jacobian @ unit.T, axis=-1) > UNSEEN * size
            out = np.where(seen, np.inf, out)
        return out


def covariance_of_file(machine: Machine) -> Covariance | None:
    """Return what the machine's file says is known of its constants; None where it says nothing. Raises InputError."""
    if machine.file is None or machine.file.covariance is None:
        return None
    return Covariance.read(machine.file.covariance, f"{machine.file.path}: covariance")


def _packed(factor: Array) -> LongText:
    """The lower triangle, row after row."""
    lower = factor[np.tril_indices(len(factor))].astype("<f4")
    return LongText(base64.b64encode(lower.tobytes()).decode("ascii"))


def _factor(section: object, size: int) -> tuple[Array, int]:
    """(n, n) of rows of numbers or of a packed text, and how many rows there were."""
    factor = np.zeros((size, size))
    if isinstance(section, str):
        values = np.frombuffer(base64.b64decode("".join(section.split()), validate=True), dtype="<f4")
        rows = int((np.sqrt(8.0 * len(values) + 1.0) - 1.0) / 2.0)
        if len(values) == size * (size + 1) // 2:
            factor[np.tril_indices(size)] = values
        return factor, rows
    if not isinstance(section, list):
        raise TypeError(f"factor is a {type(section).__name__}")
    for k, row in enumerate(section):
        factor[k, : k + 1] = np.array(str(row).split(), dtype=float)
    return factor, len(section)


def _text(row: Array) -> str:
    return " ".join(repr(float(value)) for value in row)
