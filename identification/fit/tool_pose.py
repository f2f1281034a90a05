"""How far the tool is from where a model has it: points of the tool, as read, after a rigid refit.

Readings are not the purpose; the tool's pose is. What a model says of its sensor (a volume that warps) makes readings
agree and moves no tool, so it does not count here. Frames that nobody measured do not count either: predicted points
are moved onto the fitted rows' readings as one rigid body. Nor does the part of the position that the machine's stated task
leaves free, or that no joint moves: a planar arm is not judged by what leads out of its plane.

How well the tool's position is known, and from what: the uncertainty budget of a calibrated model.

The covariance of the estimates is A^-1 (N + L) A^-1 with A = H + L, H what the readings say, N the same with the noise found
and L what the tolerances say. Its two parts are the readings' noise as it went through the fit, and what the readings left to
the drawing. What is beyond them in an average over explanations is how far these are apart. What no parameter explains adds
to all (GUM, JCGM 100:2008, 5.1.2: variances of independent sources add).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.identification.fit.align import rigid_motion
from truepose.identification.fit.decomposition import Decomposition
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.noise import unexplained
from truepose.identification.fit.turn import Turned
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording, frozen
from truepose.models import lie
from truepose.models.file.sections import ExpectedPose
from truepose.models.machine.controllability import judged_axes
from truepose.models.machine.kinematics import SymbolicModel

ENOUGH = "the validation rows"
FEWEST = 3
"""Points that a rigid refit needs."""


@dataclass(frozen=True)
class ToolPoints:
    """Points of the tool, predicted and read: (n, k, 3) each, mm, in the sensor's frame; k is 0 where none are read.

    A point of which a reading was lost is NaN. ``axes`` (a, 3): directions of which distances count, orthonormal.
    """

    predicted: Array
    read: Array
    axes: Array = field(default_factory=lambda: np.eye(3))

    @property
    def known(self) -> bool:
        """Whether the sensor reads any."""
        return bool(self.read.shape[1])

    def squares(self, fitted: Mask, held: Mask) -> Array:
        """(h,) mean squared distance, mm^2, of the points of each row held out, moved rigidly onto the rows fitted.

        Rows without a point are left out. Empty where nothing is read or too few rows are fitted.
        """
        if not self.known:
            return np.zeros(0)
        whole = np.asarray(np.isfinite(self.read).all(axis=2))
        own = fitted[:, None] & whole
        if own.sum() < FEWEST:
            return np.zeros(0)
        rotation, shift = rigid_motion(self.predicted[own], self.read[own])
        held = held & whole.any(axis=1)
        off = self.predicted[held] @ rotation.T + shift - self.read[held]
        counted = off if len(self.axes) == off.shape[2] else off @ self.axes.T
        return np.asarray(np.nanmean(np.sum(counted**2, axis=2), axis=1))


def tool_points(predictor: Predictor, p: Array, x: Array, silent: Collection[str] = ()) -> ToolPoints:
    """At parameters ``p`` (np,) and passive coordinates ``x`` (n, nx), without effects of these labels.

    Only sensors that read points (three position channels each) count.
    """
    model, recording = predictor.model, predictor.recording
    quiet = p.copy()
    quiet[[name.rpartition(":")[0] in silent for name in model.names]] = 0.0
    names, values, _ = predictor.values(quiet, x)
    at = [c.name for c in predictor.channels if c.kind == "position" and c.name in names]
    columns = [names.index(name) for name in at]
    read = [recording.observations[name] for name in at]
    count = len(at) // 3
    shape = (len(recording), count, 3)
    predicted = values[:, columns].reshape(shape) if count else np.zeros(shape)
    positions = np.column_stack(read).reshape(shape) if count else np.zeros(shape)
    return ToolPoints(predicted, positions, _axes(model, p))


def _axes(model: SymbolicModel, p: Array) -> Array:
    """Return the axes (a, 3) of the base along which errors count, in the sensor's frame."""
    turns = [p[model.names.index(f"base.r{axis}")] for axis in "xyz"]
    return np.asarray(lie.rpy_matrix(np.array(turns))[:, list(judged_axes(model))].T)


def calibrated_pose(fit: Estimate, recording: Recording, than: str = "the drawing") -> ExpectedPose | None:
    """The error of what the fit began with, called ``than``, and the fit's, on validation rows where there are enough, else on
    the fitted ones.

    None where no sensor reads points of the tool.
    """
    predictor = Predictor(fit.nominal, recording, fit.effects)
    p = fit.p.copy()
    count = len(fit.nominal.parameters)
    p[:count] = predictor.model.p_home[:count]
    p[count:] = np.where(fit.prior.sigma[count:] > 0.0, 0.0, fit.p[count:])  # what is held was there before
    x, good = predictor.assemble(p, fit.x)
    seen = good & np.isfinite(fit.residual).all(axis=1)
    fitted, held = fit.used & seen, recording.validation & seen
    rows = ENOUGH if held.sum() >= FEWEST else "the fitted rows"
    if rows != ENOUGH:
        held = fitted
    both = [tool_points(predictor, *at).squares(fitted, held) for at in ((p, x), (fit.p, fit.x))]
    if any(not len(squares) for squares in both):
        return None
    before, after = (float(np.sqrt(np.mean(squares))) for squares in both)
    return ExpectedPose(than=than, before=before, after=after, rows=rows)


READINGS, TOLERANCES, EXPLANATIONS, UNEXPLAINED = "readings", "tolerances", "explanations", "unexplained"


@dataclass(frozen=True)
class ToolSpread:
    """Positions (n, 3) of the tool in the sensor's frame, mm, and the variance (n,) of each source there, mm^2.

    A variance is that of the whole vector: the sum over x, y and z. Directions that neither readings nor tolerances determine
    are not in it.
    """

    position: Array
    variance: Mapping[str, Array]

    @property
    def std(self) -> Array:
        """(n,) combined standard uncertainty of the position, mm."""
        return np.asarray(np.sqrt(sum(self.variance.values())))


def tool_spread(fit: Estimate, recording: Recording, rows: Index, q: Array | None = None) -> ToolSpread:
    """At some rows of a recording, or at other readings ``q`` (k, nq) with the drivers of these rows.

    Poses that cannot be assembled are left out.
    """
    position, every = _tool(fit, recording, rows, q)
    free = fit.prior.free
    slopes = every[:, :, free] * fit.prior.scale[free]
    parts = _by_source(fit, slopes)
    whole, known = _spread(slopes, fit.root), sum(parts.values())
    further = np.maximum(whole - known, 0.0)
    if fit.shrunk is None and np.any(further > 1e-6 * whole):
        parts[EXPLANATIONS] = further
    own = _own(fit)
    if own > 0.0:
        parts[UNEXPLAINED] = np.full(len(position), own)
    return ToolSpread(position, parts)


def tool_moves(fit: Estimate, rows: Index, labels: Sequence[Collection[str]]) -> list[float]:
    """Return by how much (mm, rms over rows) effects with these labels move the tool, for each of ``labels``."""
    slopes, owner = _tool(fit, fit.recording, rows)[1], [n.rpartition(":")[0] for n in fit.prior.names]
    moved = [slopes @ np.where([one in own for one in owner], fit.p, 0.0) for own in labels]
    return [float(np.sqrt(np.mean(np.sum(way**2, axis=1)))) for way in moved]


def _tool(fit: Estimate, recording: Recording, rows: Index, q: Array | None = None) -> tuple[Array, Array]:
    """Return positions (n, 3) of the tool and their derivatives (n, 3, np) by the parameters, where it can be assembled."""
    part = recording.subset(rows)
    if part.from_row is not None:
        part = replace(part, from_row=part.rows)  # where the tool is depends on no other row
    if q is not None:
        part = replace(part, q=frozen(np.array(q)))
    predictor = Predictor(fit.nominal, part, fit.effects)
    x, good = predictor.assemble(fit.p, fit.x[rows])
    predictor, x = predictor.of_rows(np.flatnonzero(good)), x[good]
    pose, twist = predictor.twists(fit.p, x)
    return pose[:, :3, 3], twist[:, :3]


def _by_source(fit: Estimate, slopes: Array) -> dict[str, Array]:
    """Variance (n,) of positions with derivatives ``slopes`` (n, 3, n_free) by what it comes from."""
    if fit.shrunk is not None:
        return {READINGS: _spread(slopes, fit.root)}
    scatter, known, weight, rest = fit.scatter, fit.decomposition, fit.prior_weight, np.zeros(len(slopes))
    if isinstance(known, Turned):  # what readings do not see of long series is all tolerance
        turn, own = known.turn, known.own
        free = turn.rest.multiply((1.0 / np.where(weight > 0.0, weight, 1.0))[:, None]).tocsr()
        rest = np.sum((slopes.reshape(-1, len(weight)) @ free).reshape(len(slopes), -1) ** 2, axis=1)
        slopes = (slopes.reshape(-1, len(weight)) @ turn.matrix).reshape(*slopes.shape[:2], -1)
        known, weight = own, own.weight
    if scatter.slope != 1.0:  # a robust loss holds on to its readings by its slope
        known = Decomposition.of(np.sqrt(scatter.slope) * fit.factor[:, :-1], weight)
    posterior = known.root @ known.root.T
    pairs = zip(scatter.variance, fit.parts or (fit.factor,), strict=True)
    noise = np.vstack([np.sqrt(v) * part[:, :-1] for v, part in pairs])
    by_readings = _spread(slopes, posterior @ noise.T)
    return {READINGS: by_readings, TOLERANCES: _spread(slopes, posterior * weight) + rest}


def _spread(slopes: Array, root: Array) -> Array:
    """(n,) trace of J C J', from J (n, 3, k) and a root of C; one that is far wider than high is first made square."""
    (high, wide), flat = root.shape, slopes.reshape(-1, slopes.shape[2])
    if high / max(len(flat), 1) + high / max(wide, 1) < 1.0:
        root = np.asarray(np.linalg.qr(root.T, mode="r")).T
    return np.asarray(np.sum((flat @ root) ** 2, axis=1).reshape(slopes.shape[:2]).sum(axis=1))


def _own(fit: Estimate) -> float:
    """Variance of a position, over its three axes, that no parameter explains, mm^2."""
    left = unexplained(fit.nominal, fit.residual[fit.used], fit.effective_parameters)
    sizes = [size for kind, (size, unit) in left.items() if kind.endswith(".position") and unit == "mm"]
    return sum(3.0 * size**2 for size in sizes)
