"""The calibrations: any model and platform on one campaign, through the general API."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from telescope_simulator import nominal_machine, simulate

from truepose.identification.identifiability.observability import Columns
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models import lie
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

from .campaign import Array, Campaign
from .implicit import ClosurePredictor
from .subset_estimate import SubsetEstimate, columns_at_drawing, estimate_subset

PLATFORMS = ("rigid", "linear", "matrix")
LEAST = 0.1
"""A parameter is identified when ten of its tolerances (1 mm, 1 deg) show as one sigma of the readings."""
DIAGONAL, FULL = 1.0, 2.0
Bodies = tuple[PlacedEffect, ...]


@dataclass(frozen=True)
class Outcome:
    """One calibration: chosen parameters with their distance from the drawing (mm; u and kappa pure numbers) and from
    the truth, errors (46,) of position (um) and orientation (urad) against the measured and the true pose."""

    model: str
    platform: str
    estimate: SubsetEstimate
    deviation: Mapping[str, float]
    position: Array
    orientation: Array
    true_position: Array

    @property
    def points(self) -> Array:
        """Distances (k,) of the coordinates of a and b from the drawing, mm."""
        return np.array([v for name, v in self.deviation.items() if ".a." in name or ".b." in name])


def calibrated(campaign: Campaign, model: str, platform: str, objective: str = "readings") -> Outcome:
    """One calibration; ``objective``: ``readings`` of the targets, or ``gaps`` of the loops at the measured poses
    (Table 2 of the report), or gaps ``whitened`` by the noise of the poses."""
    predictor, placed = prepared(campaign, model, platform, objective)
    held = _is_measured if objective == "readings" else _is_measured_or_elastic
    found = estimate_subset(predictor, placed, least=LEAST, held=held)
    fit = found.fit
    change = dict(zip(fit.prior.names, fit.p - fit.prior.mean, strict=True))
    pose = _poses(campaign, predictor.machine, placed, fit.p)
    measured = _poses_read(campaign)
    true = campaign.simulation.pose_world_tool
    turn = lie.log_so3(measured[:, :3, :3].transpose(0, 2, 1) @ pose[:, :3, :3])
    return Outcome(
        model,
        platform,
        found,
        {name: float(change[name]) for name in found.subset.kept},
        1e3 * np.linalg.norm(pose[:, :3, 3] - measured[:, :3, 3], axis=1),
        1e6 * np.linalg.norm(turn, axis=1),
        1e3 * np.linalg.norm(pose[:, :3, 3] - true[:, :3, 3], axis=1),
    )


def prepared(
    campaign: Campaign, model: str, platform: str, objective: str = "readings"
) -> tuple[Predictor, Bodies]:
    """What an estimator needs: the predictor of an objective, and the platform's effects."""
    sensor = "targets" if objective == "readings" else "pose"
    machine = load_machine(campaign.machine(model, sensor))
    recording = load_recording(machine, [campaign.recording(sensor)])
    placed = bending(machine, platform, campaign.coefficients)
    if objective == "readings":
        return Predictor(machine, recording, placed), placed
    return ClosurePredictor(machine, recording, placed, whitened=objective == "whitened"), placed


def bending(machine: Machine, platform: str, coefficients: Array) -> Bodies:
    """Eq. 1 for ``linear``, eq. 2 with K as measured on the ring and its diagonal free for ``matrix``."""
    if platform == "rigid":
        return ()
    kind = effects.get("platform-deformation", "platform")()

    def form(number: float, values: Mapping[str, float] | None = None) -> PlacedEffect:
        return PlacedEffect.at(kind, machine, ("platform",), {"form": number}, values)

    if platform == "linear":
        return (form(DIAGONAL),)
    known = {f"K[{i + 1},{j + 1}]": float(coefficients[i, j]) for i in range(6) for j in range(6)}
    return form(FULL, known), form(DIAGONAL)


def against_elements(campaign: Campaign, models: Sequence[str]) -> dict[str, float]:
    """How far (um, at most) each model of the drawing puts the tool from the simulator's flexures, platform rigid."""
    truth = simulate(nominal_machine(), campaign.rho, ring_stiffness=np.inf, joints="flexure").pose_world_tool
    out = {}
    for model in models:
        predictor, _ = prepared(campaign, model, "rigid")
        away = predictor.poses(predictor.model.p_home)[0] - truth
        out[model] = float(1e3 * np.max(np.linalg.norm(away[:, :3, 3], axis=1)))
    return out


def all_columns(campaign: Campaign, model: str, *, full: bool) -> Columns:
    """Jacobian of the readings by everything, with the diagonal of K or all of it."""
    machine = load_machine(campaign.machine(model, "targets"))
    recording = load_recording(machine, [campaign.recording("targets")])
    kind = effects.get("platform-deformation", "platform")()
    placed = (PlacedEffect.at(kind, machine, ("platform",), {"form": FULL if full else DIAGONAL}),)
    return columns_at_drawing(Predictor(machine, recording, placed), placed)


def _is_measured(name: str) -> bool:
    """Whether an entry was measured on the ring: the full matrix."""
    return f"form={FULL:g}" in name


def _is_measured_or_elastic(name: str) -> bool:
    """Gaps of an elastic machine are forces, which any softening of it lessens: eq. 33 is least without stiffness."""
    return _is_measured(name) or name.endswith(".flexure") or name.startswith(("flexure.", "rod."))


def _poses(campaign: Campaign, machine: Machine, placed: Bodies, p: Array) -> Array:
    """(46, 4, 4) poses of the tool that the calibrated model predicts from the readings of the joints."""
    recording = load_recording(machine, [campaign.recording(machine.sensors[0].type)])
    return Predictor(machine, recording, placed).poses(p)[0]


def _poses_read(campaign: Campaign) -> Array:
    """(46, 4, 4) poses as measured, from the targets."""
    machine = load_machine(campaign.machine("spherical", "pose"))
    recording = load_recording(machine, [campaign.recording("pose")])
    out = np.tile(np.eye(4), (len(recording.q), 1, 1))
    out[:, :3, 3] = np.column_stack([recording.observations[c] for c in ("x", "y", "z")])
    out[:, :3, :3] = lie.exp_so3(np.column_stack([recording.observations[c] for c in ("rx", "ry", "rz")]))
    return out
