"""A Panda with a ball in sockets: no metrology, two sets, a force sensor mounted in one of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from real_recordings.common import rms, say
from truepose.identification.diagnosis.engine import diagnose
from truepose.identification.fit.estimate import Estimate, estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.load import load_machine
from truepose.models.machine import Machine

EVERY = 5
SAGGING = ("q2", "q4")
"""Joints that carry the arm's weight at arm's length."""
PANDA = """schema: truepose/machine/1
name: panda
mechanism:
  type: urdf
  file: {urdf}
  base_link: panda_link0
  tip_link: panda_hand_tcp
  joints: {{{joints}}}
sensor:
{sensors}tolerances: {{length: 0.5, angle: 0.3}}
"""
"""Stated before any fit: 0.1 mm is the arm's repeatability as its maker states it; links of a light arm are good to
half a millimetre, its axes and the zeros of its joints to 0.3 deg, a ball in a gripper to 5 mm."""
_BALL = "type: socket, spacing: 50, sigma: {xyz: 0.1}"
SENSORS = {
    "panda_1": f"{{{_BALL}, ball: [0, 0, 30], tolerance: {{ball: 5}}, sets: [panda_1]}}",
    # a force sensor of unknown height between hand and ball
    "panda_1_with_sensor": f"{{{_BALL}, name: sensor, ball: [0, 0, 30], tolerance: {{ball: [5, 5, 50]}}, "
    "sets: [panda_1_with_sensor]}",
}


def panda_files(data: Path, work: Path, sets: Sequence[str] = tuple(SENSORS)) -> tuple[Path, Path]:
    """Machine file and recording of some sets, every fifth row of a socket for validation."""
    folder = data / "panda-ball-socket"
    table = pd.read_csv(folder / "configurations.csv")
    place = table.groupby(["set", "placement", "socket"]).cumcount()
    table["role"] = np.where(place % EVERY == EVERY - 1, "validation", "calibration")
    table[table["set"].isin(sets)].to_csv(work / "panda.csv", index=False)
    joints = ", ".join(f"panda_joint{k}: q{k}" for k in range(1, 8))
    sensors = "".join(f"  - {SENSORS[name]}\n" for name in sets)
    text = PANDA.format(urdf=(folder / "panda.urdf").resolve(), joints=joints, sensors=sensors)
    (work / "panda.yaml").write_text(text, encoding="utf-8")
    return work / "panda.yaml", work / "panda.csv"


def panda_scatter(recording: Recording, fit: Estimate) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Distances (mm) of held-out balls, by set: from the mean of the held-out rows of their socket, from the socket."""
    sets = np.array(recording.labels["set"])
    seats = [
        " ".join(key)
        for key in zip(sets, *(recording.labels[c] for c in ("placement", "socket")), strict=True)
    ]
    poses, _ = Predictor(fit.machine, recording).poses(fit.p)
    values = dict(zip(fit.prior.names, fit.p, strict=True))
    out = {}
    for name in dict.fromkeys(sets.tolist()):
        prefix = "sensor." if name.endswith("with_sensor") else ""
        ball = np.array([values[f"{prefix}ball.{axis}"] for axis in "xyz"])
        rows = np.flatnonzero(recording.validation & (sets == name))
        at = pd.DataFrame(poses[rows, :3, :3] @ ball + poses[rows, :3, 3])
        mean = at.groupby([seats[k] for k in rows]).transform("mean")
        residual = fit.residual[rows] * [c.sigma for s in fit.machine.sensors for c in s.channels]
        out[str(name)] = (np.linalg.norm(at - mean, axis=1), np.linalg.norm(residual, axis=1))
    return out


def panda(data: Path, work: Path) -> None:
    """All sets with one geometry, then each set alone; the physics found beside it."""
    work.mkdir(parents=True, exist_ok=True)
    by_placement(data, work, "panda_1")
    for sets in (tuple(SENSORS), *((name,) for name in SENSORS)):
        files = panda_files(data, work, sets)
        machine = load_machine(files[0])
        recording = load_recording(machine, [files[1]])
        fit = estimate(machine, recording)
        scatter = panda_scatter(recording, fit)
        for name, (own, seat) in {**scatter, **_pooled(scatter)}.items():
            say(
                f"{' + '.join(sets)}, {name}: {rms(own):.3f} mm from the held-out rows' mean, "
                f"{rms(seat):.3f} mm from the fitted socket ({len(own)} rows)"
            )
        say(
            f"  chi2 per degree of freedom {fit.chi2_per_dof:.2f}; worst {fit.worst_parameter_sigma:.1f} tolerances"
        )
        _diagnosed(sets, files)
        for joint in SAGGING:
            _gives_way(*files, sets, joint)


def by_placement(data: Path, work: Path, name: str) -> None:
    """Each placement of one set fitted alone: does what is left come from between them?"""
    machine_file, recording_file = panda_files(data, work, (name,))
    machine = load_machine(machine_file)
    recording = load_recording(machine, [recording_file])
    place = np.array(recording.labels["placement"])
    for one in np.unique(place).tolist():
        fit = estimate(machine, recording.subset(place == one))
        say(f"{name}, placement {one} alone: chi2 per degree of freedom {fit.chi2_per_dof:.1f}")


def with_gravity(machine_file: Path) -> Machine:
    """The machine, where gravity pulls down in the arm's frame; its file says so from now on."""
    text = machine_file.read_text(encoding="utf-8") + "gravity: [0, 0, -9.80665]\n"
    machine_file.write_text(text, encoding="utf-8")
    return load_machine(machine_file)


def _diagnosed(sets: Sequence[str], files: tuple[Path, Path]) -> None:
    machine = with_gravity(files[0])
    found = diagnose(machine, load_recording(machine, [files[1]]))
    say(f"  diagnosed {' + '.join(sets)}: {found.verdict}; remainder {found.remainder}")
    for f in found.findings:
        rivals = ", ".join(f"{e.effect}@{'+'.join(e.place)} {e.probability:.2f}" for e in f.equivalents)
        say(
            f"    {f.effect}@{'+'.join(f.place)} {f.probability:.2f}; class: {rivals or 'alone'}; {f.experiment}"
        )
    held = [found.fits[stage].validation_rms or {} for stage in ("before", "after")]
    say(
        f"    from the fitted socket {held[0]['position']:.3f} mm before, {held[1]['position']:.3f} mm after; "
        f"chi2 per degree of freedom {found.fits['before'].chi2_per_dof:.2f}, {found.fits['after'].chi2_per_dof:.2f}"
    )


def _gives_way(machine_file: Path, recording_file: Path, sets: Sequence[str], joint: str) -> None:
    """Compliance of one joint alone, 1 kg in the hand, its sigma widened by what is left."""
    machine = load_machine(machine_file)
    recording = load_recording(machine, [recording_file])
    carries = {"carries": float(len(machine.load_cases) - 1)}
    term = PlacedEffect.at(effects.get("joint-compliance", "compliance")(), machine, (joint,), carries)
    fit = estimate(machine, recording, [term])
    wide = max(1.0, fit.chi2_per_dof) ** 0.5
    say(
        f"  {' + '.join(sets)}: compliance of {joint} times the mass in the hand {1e6 * fit.p[-1]:.0f} +- "
        f"{1e6 * wide * fit.std[-1]:.0f} urad/(N m) kg; chi2 per degree of freedom {fit.chi2_per_dof:.2f}"
    )


def _pooled(scatter: dict[str, tuple[np.ndarray, np.ndarray]]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    if len(scatter) == 1:
        return {}
    own, seat = zip(*scatter.values(), strict=True)
    return {"together": (np.concatenate(own), np.concatenate(seat))}
