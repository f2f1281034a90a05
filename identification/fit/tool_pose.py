"""How far the tool is from where a model has it: points of the tool, as read, after a rigid refit.

Readings are not the purpose; the tool's pose is. What a model says of its sensor (a volume that warps) makes readings
agree and moves no tool, so it does not count here. Frames that nobody measured do not count either: predicted points
are moved onto the fitted rows' readings as one rigid body. Nor does the part of the position that the machine's stated task
leaves free, or that no joint moves: a planar arm is not judged by what leads out of its plane.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.fit.align import rigid_motion
from truepose.identification.fit.estimate import Estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.file.machine_file import ExpectedPose
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
    return ExpectedPose(than, before, after, rows)


__all__ = ["ToolPoints", "calibrated_pose", "tool_points"]
