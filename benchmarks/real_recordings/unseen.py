"""What a diagnosed model is worth on rows that it has not seen, on another campaign, and in halves of its recording.

Held-out rows: rms before and after, and the error over what ``predict`` says of itself and the sensor. Carried: the model of
one campaign of the UR10 on another, with base and tool refitted, beside the plain calibration. Replication: names
whose class is said with 0.9 or more in a half of a recording and that the whole does not say (recordings up to 2,000 rows).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from real_recordings.common import FILES, Mask, rms, say
from real_recordings.panda import SENSORS, panda_files
from real_recordings.ur10 import mark_held_out
from truepose.identification.diagnosis.engine import diagnose
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimate import Estimate, estimate
from truepose.identification.fit.noise import channel_groups, unexplained
from truepose.identification.fit.problem import prior_of
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predict import predict
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine import Machine

SURE, STATED = 0.9, 0.5
HALVED = 2_000
EVERY = 5
"""Every fifth row of a recording without goals is held out."""
CARRIED = ("base.", "tool.")
CAMPAIGNS = (*FILES, "random")


def unseen(data: Path, work: Path, wanted: Sequence[str] = ()) -> None:
    """All three, recording by recording; some of these only."""
    work.mkdir(parents=True, exist_ok=True)
    every = _recordings(data, work)
    for name in wanted or every:
        machine, recording = every[name]
        found = diagnose(machine, recording)
        say(f"{name}: {found.verdict}; " + "; ".join(_name(f) for f in sorted(_names(found, STATED))))
        _held_out(name, found, work)
        if name == "configurations":
            random = load_recording(machine, [work / "random.csv"])
            for fit, what in ((found.before, "plain calibration"), (found.after, "diagnosed model")):
                carry(fit, random, f"{name} -> random, base and tool refitted, {what}")
        if len(recording) <= HALVED:
            _replication(name, machine, recording, found)


def _recordings(data: Path, work: Path) -> Mapping[str, tuple[Machine, Recording]]:
    """Every recording with its machine, rows for validation marked."""
    mark_held_out(data, work, CAMPAIGNS)
    arm = load_machine(data / "ur10-laser-tracker" / "machine.yaml")
    out = {name: (arm, load_recording(arm, [work / f"{name}.csv"])) for name in CAMPAIGNS}
    stewart = load_machine(data / "stewart-mocap" / "machine.yaml")
    for session in ("session_108", "session_60"):
        recording = load_recording(stewart, [data / "stewart-mocap" / f"{session}.csv"])
        held = np.arange(len(recording)) % EVERY == EVERY - 1
        out[session] = stewart, replace(recording, validation=held)
    files = panda_files(data, work, tuple(SENSORS))
    panda = load_machine(files[0])
    out["panda"] = panda, load_recording(panda, [files[1]])
    return out


def _held_out(name: str, found: Diagnosis, work: Path) -> None:
    """rms of held-out rows, and their error over sigma and ``.std`` together, in the sensor's columns of length."""
    fits = {stage: found.fits[stage].validation_rms or {} for stage in ("before", "after")}
    told = ", ".join(
        f"{kind} {fits['before'][kind]:.4g} -> {fits['after'][kind]:.4g}" for kind in fits["after"]
    )
    write_calibrated(work / f"{name}.yaml", found.after, found.recording)
    machine = load_machine(work / f"{name}.yaml")
    frame = predict(machine, found.recording)
    rows, z = found.recording.validation, []
    for sensor in machine.sensors:
        sigma = dict(zip(sensor.columns, (c.sigma for c in sensor.channels), strict=False))
        for column, unit in sensor.columns.items():
            read = found.recording.observations.get(column)
            if unit != "mm" or read is None:
                continue
            std = np.hypot(frame[f"{column}.std"].to_numpy(), sigma.get(column, sensor.channels[0].sigma))
            z.append(((read - frame[column].to_numpy()) / std)[rows])
    every = np.concatenate(z) if z else _channel_scores(found.after, found.recording)
    every = every[np.isfinite(every)]
    inside = float(np.mean(np.abs(every) < 1.96))
    say(f"  held out: {told}; z rms {rms(every):.2f}, {100 * inside:.0f} % inside 1.96")


def _channel_scores(fit: Estimate, recording: Recording) -> np.ndarray:
    """The same from whitened residuals, for sensors that compare rows and have no column of length (a ball in sockets)."""
    predictor = Predictor(fit.machine, recording, fit.effects)
    own = unexplained(fit.machine, fit.residual[fit.used], fit.effective_parameters)
    noise = np.ones(fit.residual.shape[1])
    for name, at in channel_groups(fit.machine).items():
        for k in at:
            noise[k] += (own.get(name, (0.0, ""))[0] / fit.machine.channels[k].sigma) ** 2
    free, out = fit.prior.free, []
    for block in predictor.blocks(fit.p, fit.x, fit.used):
        rows = recording.validation[block.rows]
        moved = (block.jacobian[rows][:, :, free] * fit.prior.scale[free]) @ fit.root
        out.append((block.residual[rows] / np.sqrt(noise + np.sum(moved**2, axis=2))).ravel())
    scores = np.concatenate(out)
    return np.asarray(scores[scores != 0.0])  # a row that refers to itself says nothing


def carry(fit: Estimate, target: Recording, label: str) -> None:
    """The model of a fit on another recording, all of it known but base and tool; position rms of its held-out rows."""
    machine, effects = fit.machine, tuple(replace(e, spread=0.0) for e in fit.fitted_effects())
    prior = prior_of(machine, effects)
    values = np.concatenate([fit.p[: len(machine.parameters)], *[e.amplitudes for e in effects]])
    moves = np.array([name.startswith(CARRIED) and "@" not in name for name in prior.names])
    prior = replace(prior, mean=values, sigma=np.where(moves, np.inf, 0.0))
    found = estimate(machine, target, effects, prior=prior, start=values, loss="huber")
    rows = target.validation
    sigma = next(c.sigma for c in machine.channels if c.kind == "position")
    at = [k for k, c in enumerate(machine.channels) if c.kind == "position"]
    say(f"  {label}: {rms(sigma * found.residual[rows][:, at]):.3f} mm of {int(rows.sum())} held-out rows")


def _replication(name: str, machine: Machine, recording: Recording, whole: Diagnosis) -> None:
    """Names of halves, in time and at random, that the whole recording does not say."""
    used = np.flatnonzero(~recording.validation)
    shuffled = np.random.default_rng(1).permutation(used)
    said = _names(whole, 0.0)
    total = lost = 0
    for order, how in ((used, "in time"), (shuffled, "at random")):
        for half in np.array_split(order, 2):
            found = diagnose(machine, recording.subset(_mask(half, len(recording))))
            sure = _names(found, SURE)
            total, lost = total + len(sure), lost + len(sure - said)
            say(
                f"  half {how}: {found.verdict}, {len(sure)} sure names; not in the whole: {_listed(sure - said)}"
            )
    say(f"  {name}: replication failed for {lost} of {total} names")


def _mask(rows: np.ndarray, count: int) -> Mask:
    out = np.zeros(count, dtype=bool)
    out[rows] = True
    return out


def _names(found: Diagnosis, least: float) -> set[tuple[str, tuple[str, ...]]]:
    """Effects and places whose class is said with ``least`` or more; with 0, whatever any class holds."""
    out = {(f.effect, f.place) for f in found.findings if f.certainty >= least}
    if least == 0.0:
        out |= {(e.effect, e.place) for f in found.findings for e in f.equivalents}
        out |= {(f.family, (p,)) for f in found.findings if f.family for p in f.place}
    return out


def _name(cause: tuple[str, tuple[str, ...]]) -> str:
    return f"{cause[0]}@{'+'.join(cause[1])}"


def _listed(causes: set[tuple[str, tuple[str, ...]]]) -> str:
    return "; ".join(_name(c) for c in sorted(causes)) or "none"
