"""The steps that a large fit is solved for: of a long series, only the directions that the fitted rows see.

A joint that turned by a third of a turn cannot tell 60 orders (120 coefficients) apart. Let S (n, c) be what each coefficient
does to the joint in each row and W the rows' information about a shift of it. Where all coefficients have one 1-sigma q, in
steps, readings and prior agree on the directions of S'WS: along one of information h, a coefficient N(0, q^2) is known to
q^2 / (1 + h q^2). Where h q^2 is next to nothing, that is the prior: such a direction stays at its mean and keeps its 1-sigma.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from truepose.arrays import Array, Index
from truepose.identification import prior
from truepose.identification.fit.decomposition import Decomposition
from truepose.identification.fit.leastsquares import Rows
from truepose.identification.prediction.by_ports import ByPorts, Part
from truepose.identification.prediction.sensor_rows import Block
from truepose.threads import Cached

ALIKE = 1e-9
"""Share by which 1-sigmas of one series may differ: rounding."""
UNSEEN = 1e-6
"""Information in units of the prior's below which a direction stays where it is: half of it is what it could gain, in nats."""


@dataclass(frozen=True)
class Turn:
    """From k steps to those of the free entries (n,): ``plain`` (p,) entries as they are, first; then for each series its
    entries (c,) and orthonormal directions (c, r)."""

    plain: Index
    series: tuple[tuple[Index, Array], ...]

    @Cached
    def matrix(self) -> sp.csr_array:
        """(n, k), orthonormal columns."""
        return self._placed([turn for _, turn in self.series], np.ones(len(self.plain)))

    @Cached
    def rest(self) -> sp.csr_array:
        """(n, n - k) the other directions, which readings do not see."""
        turns = [np.linalg.qr(turn, mode="complete")[0][:, turn.shape[1] :] for _, turn in self.series]
        return self._placed(turns, np.ones(0))

    def _placed(self, turns: Sequence[Array], plain: Array) -> sp.csr_array:
        own = sp.coo_array(sp.block_diag([sp.diags_array(plain), *turns], format="csr"))
        rows = np.concatenate([self.plain[: len(plain)], *(at for at, _ in self.series)])
        size = len(self.plain) + sum(len(at) for at, _ in self.series)
        return sp.csr_array((own.data, (rows[own.coords[0]], own.coords[1])), shape=(size, own.shape[1]))

    def of_part(self, part: Part) -> Part:
        """Rows of [J r] by these steps, r last as before."""
        assert part.ports is not None
        place, width = np.full(int(max(part.at)) + 1, -1), self.matrix.shape[1]
        place[self.plain] = np.arange(len(self.plain))
        place[-1] = width
        ports, own = part.ports, part.ports.of_columns(place[part.ports.column] >= 0)
        where = {int(column): k for k, column in enumerate(ports.column)}
        port, column, values = [own.port], [place[own.column]], [own.values]
        first = len(self.plain)
        for at, turn in self.series:
            these = [where[int(k)] for k in at]
            port.append(np.full(turn.shape[1], ports.port[these[0]]))
            column.append(np.arange(first, first := first + turn.shape[1]))
            values.append(ports.values[:, these] @ turn)
        by = ByPorts(ports.slopes, np.concatenate(port), np.concatenate(column), np.hstack(values))
        return Part(part.dense, place[part.at], by)

    def of_block(self, block: Block, free: Index, scale: Array) -> Array:
        """(n, m, k) derivative of a block's residuals by these steps; ``free`` (n_free,) entries of p, ``scale`` (np,)."""
        place = np.full(len(scale), -1)
        place[free] = np.arange(len(free))
        rows = np.arange(len(block.residual))
        part = block.part(rows, place, scale, np.ones(len(rows)))
        if part is None:
            return np.asarray(block.jacobian[:, :, free] * scale[free] @ self.matrix.toarray())
        return self.of_part(part).written(self.matrix.shape[1] + 1)[:, :, :-1]

    def of_prior(self, weight: Array, pull: Array) -> tuple[Array, Array]:
        """Weights (k,) and pulls (k,) of the prior by these steps, from those of the free entries (n,)."""
        return self.held(weight), np.asarray(self.matrix.T @ pull)

    def held(self, weight: Array) -> Array:
        """(k,) weights of the prior: those of a series are all alike."""
        return np.concatenate(
            [weight[self.plain], *(np.full(turn.shape[1], weight[at[0]]) for at, turn in self.series)]
        )

    def of_rows(self, rows: Array) -> Array:
        """Rows (k, n + 1) of [J r] by these steps."""
        return np.column_stack([rows[:, :-1] @ self.matrix, rows[:, -1]])


def turn_of(effects: Sequence[Index], parts: Iterable[Rows], weight: Array) -> Turn | None:
    """Of rows ``parts`` of [J r] by the free entries; ``effects``: free entries of each effect, ``weight`` (n,) of the prior.

    None where no effect has a long series of one port, of one 1-sigma.
    """
    grams = {
        k: np.zeros((len(at), len(at)))
        for k, at in enumerate(effects)
        if len(at) > prior.LONG and np.all(weight[at] > 0.0) and np.ptp(weight[at]) < ALIKE * weight[at[0]]
    }
    for part in parts if grams else ():
        places = {} if not isinstance(part, Part) or part.ports is None else _places(part.ports)
        for k in list(grams):
            these = np.array([places.get(int(column), -1) for column in effects[k]])
            own = None if min(these) < 0 else _information(part, these)
            if own is None:
                del grams[k]
            else:
                grams[k] += own
    series = []
    for k, gram in grams.items():
        series.append((effects[k], seen_directions(gram / weight[effects[k][0]] ** 2, UNSEEN)))
    if not series:
        return None
    long = np.concatenate([at for at, _ in series])
    return Turn(np.setdiff1d(np.arange(len(weight)), long), tuple(series))


def seen_directions(information: Array, least: float) -> Array:
    """(c, r) orthonormal directions with more than the least of the readings' ``information`` (c, c), one at least."""
    values, vectors = np.linalg.eigh(information)
    return np.asarray(vectors[:, -max(int(np.sum(values > least)), 1) :])


def _places(ports: ByPorts) -> dict[int, int]:
    """Where each entry stands among those that follow ports; an entry of several ports stands nowhere."""
    entries, first, count = np.unique(ports.column, return_index=True, return_counts=True)
    alone = count == 1
    return dict(zip(entries[alone].tolist(), first[alone].tolist(), strict=True))


def _information(part: Rows, these: Index) -> Array | None:
    """(c, c) of the readings about entries that follow one port; None where they follow several."""
    assert isinstance(part, Part) and part.ports is not None
    port, values = part.ports.port[these], part.ports.values[:, these]
    if len(np.unique(port)) > 1:
        return None
    return np.asarray(values.T @ (np.sum(part.ports.slopes[:, :, port[0]] ** 2, axis=1)[:, None] * values))


@dataclass(frozen=True)
class Turned(Decomposition):
    """What is known of the free entries, from what is known of the steps that were solved for: ``own``.

    ``directions`` are not held: there are many.
    """

    own: Decomposition
    turn: Turn

    @classmethod
    def by(cls, factor: Array, weight: Array, turn: Turn) -> Turned:
        """From a factor (k, steps) of the scaled Jacobian by the steps; weight (n,) of the free entries."""
        own = Decomposition.of(factor, turn.held(weight))
        singular = np.append(own.singular, np.zeros(turn.rest.shape[1]))
        return cls(singular, np.zeros((0, len(weight))), weight, own.rank, own, turn)

    @property
    def seen(self) -> Array:
        """(rank, n) orthonormal directions that the readings see, best first."""
        return np.asarray(self.own.seen @ self.turn.matrix.T)

    @property
    def null_space(self) -> Array:
        """(n - rank, n) orthonormal directions that no reading sees."""
        return np.vstack([self.own.null_space @ self.turn.matrix.T, self.turn.rest.T.toarray()])

    @property
    def lengths(self) -> Array:
        """(n,) length of each column of the scaled Jacobian."""
        rows = self.own.singular[:, None] * self.own.directions
        return np.asarray(np.linalg.norm(rows @ self.turn.matrix.T, axis=0))

    @Cached
    def unknown(self) -> Array:
        """(k, n) orthonormal directions that neither readings nor prior determine."""
        return np.asarray(self.own.unknown @ self.turn.matrix.T)

    @Cached
    def root(self) -> Array:
        """(n, k) F with covariance F F' in steps; without the directions that nothing determines."""
        return self._beside_rest(self.own.root)

    def root_with(self, slope: float, noise: Sequence[Array]) -> Array:
        """The same with readings not as noisy as stated; ``noise`` by the steps that were solved for."""
        return self._beside_rest(self.own.root_with(slope, noise))

    def _beside_rest(self, root: Array) -> Array:
        free = 1.0 / np.where(self.weight > 0.0, self.weight, 1.0)
        return np.hstack([self.turn.matrix @ root, (self.turn.rest.multiply(free[:, None])).toarray()])

    @property
    def effective(self) -> float:
        """Degrees of freedom that the readings use."""
        return self.own.effective

    def share(self, factor: Array) -> float:
        """Degrees of freedom that readings with this factor (k, steps) use."""
        return self.own.share(factor)
