"""Stewart platform with motion capture: two sessions alone and together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from real_recordings.common import say
from truepose.identification.diagnosis.engine import diagnose
from truepose.identification.fit.estimate import Estimate
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.load import load_machine


def leg_errors(fit: Estimate, recording: Recording) -> np.ndarray:
    """(n, 6) leg length from the measured pose less offset + gain * reading, mm (zero shifts not included)."""
    values = dict(zip(fit.prior.names, fit.p, strict=True))
    for name, value in list(values.items()):
        if name.startswith("wrong-constant@"):
            values[name.removeprefix("wrong-constant@").split(":")[0]] += value
    world = np.tile(np.eye(4), (len(recording), 1, 1))
    world[:, :3, 3] = np.column_stack([recording.observations[c] for c in ("x", "y", "z")])
    world[:, :3, :3] = lie.exp_so3(np.column_stack([recording.observations[c] for c in ("rx", "ry", "rz")]))
    shift = {a: values.get(f"frame-shift@base,session=1:{a}", 0.0) for a in ("x", "y", "z", "rx", "ry", "rz")}
    moved = _pose([shift[a] for a in ("x", "y", "z")], [shift[a] for a in ("rx", "ry", "rz")])
    after = (recording.session_rank() >= 1)[:, None, None]
    base = np.where(after, _frame(values, "base") @ moved, _frame(values, "base"))
    platform = np.linalg.inv(base) @ world @ np.linalg.inv(_frame(values, "tool"))
    out = []
    for leg in range(1, 7):
        a, b = (np.array([values[f"leg{leg}.{point}.{c}"] for c in "xyz"]) for point in "ab")
        length = np.linalg.norm(platform[:, :3, :3] @ b + platform[:, :3, 3] - a, axis=1)
        out.append(length - values[f"leg{leg}.offset"] - values[f"leg{leg}.gain"] * recording.q[:, leg - 1])
    return np.array(out).T


def _frame(values: dict[str, float], frame: str) -> np.ndarray:
    return _pose([values[f"{frame}.{a}"] for a in "xyz"], [values[f"{frame}.r{a}"] for a in "xyz"])


def _pose(xyz: Sequence[float], rpy: Sequence[float]) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = lie.rpy_matrix(np.array(rpy)), xyz
    return out


def stewart(data: Path) -> None:
    """Each session alone, then both together."""
    folder = data / "stewart-mocap"
    machine = load_machine(folder / "machine.yaml")
    for names in (["session_108"], ["session_60"], ["session_108", "session_60"]):
        recording = load_recording(machine, [folder / f"{name}.csv" for name in names])
        found = diagnose(machine, recording)
        say(f"{' + '.join(names)}: {found.verdict}")
        for f in found.findings:
            rivals = ", ".join(f"{e.effect}@{'+'.join(e.place)} {e.probability:.2f}" for e in f.equivalents)
            amounts = ", ".join(f"{n} {q.value:.4g} +- {q.std:.2g} {q.unit}" for n, q in f.parameters.items())
            say(
                f"  {f.effect}@{'+'.join(f.place)} {f.probability:.2f}: {amounts}; class: {rivals or 'alone'}"
            )
        proof = found.proof
        say(
            f"  held-out ratio {'none' if proof is None else f'{proof.ratio:.2f}'}; remainder {found.remainder}; "
            f"next: {'; '.join(f.experiment for f in found.findings) or 'none asked for'}"
        )
        error = leg_errors(found.after, recording)
        by_session = [np.sqrt(np.mean(error[recording.session == s] ** 2)) for s in recording.sessions]
        say(
            f"  leg error rms {np.sqrt(np.mean(error**2)):.3f} mm; by session {[round(float(v), 3) for v in by_session]}"
        )
