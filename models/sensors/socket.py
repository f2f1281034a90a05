"""A ball on the tool that sits in fixed sockets: no instrument, only rows that must put the ball in one place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field
from scipy.sparse import csr_matrix

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.models.file.fields import Length, LengthSigma, LengthToleranceVector, LengthVector, Section
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.mechanism import Parameter
from truepose.models.machine.sensor import (
    TOOL_IN_WORLD,
    Channel,
    Comparison,
    Rows,
    Sensor,
    View,
    ViewSection,
    sensors,
)
from truepose.models.machine.sensor import prefix as opening

SET, PLACEMENT, SOCKET = "set", "placement", "socket"


class _Sigma(Section):
    xyz: LengthSigma
    """1-sigma of how the ball seats, in each direction."""


class _Tolerance(Section):
    ball: LengthToleranceVector = (0.0, 0.0, 0.0)
    """1-sigma of the ball's place."""


class _SocketSection(ViewSection):
    type: Literal["socket"]
    """A ball on the tool sits in fixed sockets: no readings, but columns `placement`, `socket` and perhaps `set`."""
    name: str | None = None
    """Tells several balls apart: the parameters are then `NAME.ball.x` ..."""
    sets: tuple[str, ...] = ()
    """Labels in the column `set` that were recorded with this ball; left out: all."""
    ball: LengthVector = (0.0, 0.0, 0.0)
    """Centre of the ball, in the tool frame."""
    spacing: Length | None = Field(default=None, gt=0.0)
    """Known distance between the two sockets of one placement; left out: unknown."""
    sigma: _Sigma
    """How exactly the ball comes back to the same point."""
    tolerance: _Tolerance = _Tolerance()
    """How well the ball's place is known; left out: exactly."""


@sensors.add("socket")
@dataclass(frozen=True)
class Socket(Sensor):
    """The ball ``ball`` (tool frame), seated: rows of one set, placement and socket share one unknown point.

    ``spacing`` (mm) is the known distance of the two sockets of a placement. The base frame is not seen. ``sets``
    are those that were recorded with this ball, all when empty: another sensor has the ball of the others.
    """

    parameters: tuple[Parameter, ...] = field()
    sigma: float
    spacing: float | None = None
    sets: tuple[str, ...] = ()
    view: View = TOOL_IN_WORLD
    type = "socket"
    touches = True
    label_columns: ClassVar[tuple[str, ...]] = (PLACEMENT, SOCKET)
    optional_labels: ClassVar[tuple[str, ...]] = (SET,)

    @classmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> Socket:
        """From ``ball``, ``spacing``, ``sigma: {xyz}``, ``tolerance: {ball}``, ``sets``, ``tip``, ``in`` and ``name``.

        The name opens those of the parameters, where another sensor has a ball too.
        """
        parsed = context.parse(_SocketSection, section)
        prefix = opening(parsed.name)
        ball = context.vector(f"{prefix}ball", parsed.ball, ("ball",), "sensor", parsed.tolerance.ball)
        return cls(ball, parsed.sigma.xyz, parsed.spacing, parsed.sets, parsed.view(context))

    @property
    def columns(self) -> Mapping[str, str]:
        """None: nothing is read but the joints."""
        return {}

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Three lengths from the ball to its socket."""
        return tuple(Channel(p.name, "mm", self.sigma, "position", "ball") for p in self.parameters)

    @property
    def compares(self) -> bool:
        """Always: one row alone says nothing."""
        return True

    @property
    def measures_length(self) -> bool:
        """Only where the distance between two sockets is known."""
        return self.spacing is not None

    def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
        """Position (3,) of the ball, mm, sensor frame; ``comparison`` turns it into distances from the sockets."""
        return world[:3, :3] @ ca.vertcat(*(s[p.name] for p in self.parameters)) + world[:3, 3]

    def noisy(self, values: Array, rng: np.random.Generator) -> Array:
        """The values (n, 0) themselves: nothing is read, so that nothing is noisy."""
        return values

    def cautions(self, labels: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
        """Several sets, one ball: right only if the tool stayed as it was."""
        named = list(dict.fromkeys(labels.get(SET, ())))
        if self.sets or len(named) < 2:
            return ()
        return (
            f"the sets {', '.join(named)} are taken to have one ball; where the tool was mounted anew between them, "
            f"give each ball a sensor of its own (`sets: [{named[0]}]`, and a `name` for all but one)",
        )

    def comparison(self, rows: Rows) -> Comparison | None:
        """The sockets that the labels name; None where the columns are missing."""
        if any(name not in rows.labels for name in self.label_columns):
            return None
        sets = rows.labels.get(SET, ("",) * len(rows.weight))
        own = np.array([not self.sets or name in self.sets for name in sets], dtype=bool)
        weight = np.where(own, rows.weight, 0.0)
        keys = list(zip(sets, rows.labels[PLACEMENT], rows.labels[SOCKET], strict=True))
        known = list(dict.fromkeys(keys))
        place = {key: k for k, key in enumerate(known)}
        group = np.array([place[key] for key in keys], dtype=np.intp)
        fitted = np.bincount(group, weight > 0, len(known)) > 0
        pairs = [] if self.spacing is None else _pairs(known, rows.files)
        return Seats(
            group=group,
            weight=np.where(fitted[group], weight, 1.0),
            own=own,
            fitted=fitted,
            pairs=tuple((a, b) for a, b in pairs if fitted[a] and fitted[b]),
            spacing=self.spacing or 0.0,
        )


def _pairs(known: list[tuple[str, str, str]], files: tuple[str, ...]) -> list[tuple[int, int]]:
    """The two sockets of each placement."""
    members: dict[tuple[str, str], list[int]] = {}
    for k, (name, placement, _) in enumerate(known):
        members.setdefault((name, placement), []).append(k)
    for (_, placement), sockets in members.items():
        if len(sockets) > 2:
            found = ", ".join(known[k][2] for k in sockets)
            raise InputError(
                f"{', '.join(files)}: column 'socket': found the sockets {found} of placement {placement!r}, "
                "expected two at most: the sensor's `spacing` is the distance of two"
            )
    return [(sockets[0], sockets[1]) for sockets in members.values() if len(sockets) == 2]


@dataclass(frozen=True)
class Seats(Comparison):
    """Each row's ball less its socket: the point that suits the socket's rows best, in least squares.

    The points are solved for in closed form, so that the residuals are those of a fit with the points among its
    unknowns (variable projection). Without a spacing a socket stands at the weighted mean of its rows. Two sockets
    at a known distance are moved until their means keep it: with weights A and B and means L apart, the first moves
    by (L - spacing) B / (A + B) towards the second and the second by the rest, which costs
    (L - spacing)^2 A B / (A + B), the least there is.

    group (n,): socket of each row; weight (n,): what rows count; own (n,): rows with this ball, the others read 0;
    fitted (k,): sockets with rows that are fitted (others stand at the mean of their own rows); pairs: sockets at
    the known distance ``spacing``, mm.
    """

    group: Index
    weight: Array
    own: Mask
    fitted: Mask
    pairs: tuple[tuple[int, int], ...]
    spacing: float

    @property
    def unknowns(self) -> int:
        """Three a socket, one less where a spacing is known; a lone row says nothing, its zeros are no readings."""
        paired = {k for pair in self.pairs for k in pair}
        rows = np.bincount(self.group, self.weight > 0, len(self.fitted))
        free = [k for k in np.flatnonzero(self.fitted & (rows > 1)) if k not in paired]
        return 3 * len(free) + 5 * len(self.pairs)

    def values(self, raw: Array) -> Array:
        """(n, 3) ball less socket, mm, from the ball's positions (n, 3)."""
        points = self._mean(raw)
        for a, b, share in self._shares():
            apart = points[a] - points[b]
            length = max(float(np.linalg.norm(apart)), 1e-300)
            correction = apart * (length - self.spacing) / length
            points[a] -= (1 - share) * correction
            points[b] += share * correction
        return np.where(self.own[:, None], raw - points[self.group], 0.0)

    def changes(self, raw: Array, change: Array) -> Array:
        """(n, 3, w) exact derivative of ``values`` along (n, 3, w) changes of the ball's positions."""
        means, slopes = self._mean(raw), self._mean(change)
        for a, b, share in self._shares():
            apart, moved = means[a] - means[b], slopes[a] - slopes[b]
            length = max(float(np.linalg.norm(apart)), 1e-300)
            along = apart / length
            longer = along @ moved
            # of apart (1 - spacing / length)
            correction = (
                moved * (1 - self.spacing / length) + np.outer(apart, longer) * self.spacing / length**2
            )
            slopes[a] -= (1 - share) * correction
            slopes[b] += share * correction
        return np.where(self.own[:, None, None], change - slopes[self.group], 0.0)

    def _shares(self) -> list[tuple[int, int, float]]:
        """Each pair with the first socket's share of the weight."""
        total = np.bincount(self.group, self.weight, len(self.fitted))
        return [(a, b, float(total[a] / (total[a] + total[b]))) for a, b in self.pairs]

    def _mean(self, values: Array) -> Array:
        """(k, ...) weighted mean over each socket's rows; rows that do not count may hold anything."""
        total = np.bincount(self.group, self.weight, len(self.fitted))
        at = (self.group, np.arange(len(self.group)))
        average = csr_matrix((self.weight / total[self.group], at), (len(self.fitted), len(self.group)))
        flat = values.reshape(len(values), -1)
        flat = np.where((self.weight > 0)[:, None], flat, 0.0)
        return np.asarray(average @ flat).reshape(len(self.fitted), *values.shape[1:])
