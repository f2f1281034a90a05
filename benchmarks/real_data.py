"""Figures on real recordings: UR10 with a laser tracker, a Stewart platform with motion capture, a Panda in sockets.

    python benchmarks/real_data.py stewart DATA_FOLDER
    python benchmarks/real_data.py ur10 DATA_FOLDER WORK_FOLDER
    python benchmarks/real_data.py panda DATA_FOLDER WORK_FOLDER

DATA_FOLDER holds ``ur10-laser-tracker/``, ``stewart-mocap/`` and ``panda-ball-socket/``. For the UR10 the rows whose
goal modulo 10 is 3, 6 or 9 are marked validation; each file is diagnosed through the command line (results stay in
WORK_FOLDER), then the periodic joint functions of the two files are compared and carried from one file to the other.
For the Panda it is every fifth row of a socket.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from truepose.identification.align import aligned_start
from truepose.identification.diagnosis.engine import diagnose
from truepose.identification.diagnosis.summary import rms_by_kind
from truepose.identification.estimate import Estimate, estimate
from truepose.identification.load import load_recording
from truepose.identification.prediction import Predictor
from truepose.identification.recording import Recording
from truepose.models import lie
from truepose.models.effects.base import PlacedEffect
from truepose.models.load import load_machine

FILES = ("configurations", "grid")
HELD_OUT = (3, 6, 9)
LOW_ORDERS = 3
EVERY = 5
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


def say(text: str) -> None:
    """One line, at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def leg_errors(fit: Estimate, recording: Recording) -> np.ndarray:
    """(n, 6) leg length from the measured pose less offset + gain * reading, mm (zero shifts not included)."""
    values = dict(zip(fit.prior.names, fit.p, strict=True))
    for name, value in list(values.items()):
        if name.startswith("wrong-constant@"):
            values[name.removeprefix("wrong-constant@").split(":")[0]] += value
    world = np.tile(np.eye(4), (len(recording), 1, 1))
    world[:, :3, 3] = np.column_stack([recording.readings[c] for c in ("x", "y", "z")])
    world[:, :3, :3] = lie.exp_so3(np.column_stack([recording.readings[c] for c in ("rx", "ry", "rz")]))
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
        error = leg_errors(found.after, recording)
        by_session = [np.sqrt(np.mean(error[recording.session == s] ** 2)) for s in recording.sessions]
        say(
            f"  leg error rms {np.sqrt(np.mean(error**2)):.3f} mm; by session {[round(float(v), 3) for v in by_session]}"
        )


def ur10(data: Path, work: Path) -> None:
    """Diagnose both files, then compare them."""
    machine = data / "ur10-laser-tracker" / "machine.yaml"
    work.mkdir(parents=True, exist_ok=True)
    for name in FILES:
        table = pd.read_csv(data / "ur10-laser-tracker" / f"{name}.csv")
        table["role"] = np.where(np.isin(table["goal"] % 10, HELD_OUT), "validation", "calibration")
        table.to_csv(work / f"{name}.csv", index=False)
        if not (work / name / "diagnosis.json").exists():
            start = time.perf_counter()
            command = [
                sys.executable,
                "-m",
                "truepose.cli",
                "diagnose",
                machine,
                work / f"{name}.csv",
                "-o",
                work / name,
            ]
            subprocess.run([*map(str, command)], check=True, stdout=subprocess.DEVNULL)
            say(f"{name}: diagnosed in {time.perf_counter() - start:.0f} s")
        fits = pd.read_json(work / name / "diagnosis.json", typ="series")["fit"]
        held = [fits[stage]["validation_rms"]["position"]["value"] for stage in ("before", "after")]
        say(
            f"{name}: held-out position rms {held[0]:.0f} um with geometry only, {held[1]:.0f} um with the physics named"
        )
    improved = {name: load_machine(work / name / "improved.yaml") for name in FILES}
    recordings = {name: load_recording(improved[name], [work / f"{name}.csv"]) for name in FILES}
    _compare({name: improved[name].effects for name in FILES}, recordings)
    for source, target in (FILES, FILES[::-1]):
        _carry(
            machine, improved[source].effects, recordings[source], recordings[target], f"{source} -> {target}"
        )


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
    for sets in (tuple(SENSORS), *((name,) for name in SENSORS)):
        files = panda_files(data, work, sets)
        machine = load_machine(files[0])
        recording = load_recording(machine, [files[1]])
        fit = estimate(machine, recording)
        scatter = panda_scatter(recording, fit)
        for name, (own, seat) in {**scatter, **_pooled(scatter)}.items():
            say(
                f"{' + '.join(sets)}, {name}: {_rms(own):.3f} mm from the held-out rows' mean, "
                f"{_rms(seat):.3f} mm from the fitted socket ({len(own)} rows)"
            )
        say(
            f"  chi2 per degree of freedom {fit.chi2_per_dof:.2f}; worst {fit.worst_parameter_sigma:.1f} tolerances"
        )
    files = panda_files(data, work)
    files[0].write_text(
        files[0].read_text(encoding="utf-8") + "gravity: [0, 0, -9.80665]\n", encoding="utf-8"
    )
    machine = load_machine(files[0])
    found = diagnose(machine, load_recording(machine, [files[1]]))
    say(
        "diagnosed: "
        + ", ".join(f"{f.effect}@{'+'.join(f.place)} {f.probability:.2f}" for f in found.findings)
    )
    held = [found.fits[stage].validation_rms or {} for stage in ("before", "after")]
    say(f"  from the fitted socket {held[0]['position']:.3f} mm before, {held[1]['position']:.3f} mm after")


def _pooled(scatter: dict[str, tuple[np.ndarray, np.ndarray]]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    if len(scatter) == 1:
        return {}
    own, seat = zip(*scatter.values(), strict=True)
    return {"together": (np.concatenate(own), np.concatenate(seat))}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _curve(effects: Sequence[PlacedEffect], joint: str, angle: np.ndarray) -> np.ndarray:
    """Periodic error of a joint over its angle, rad."""
    out = np.zeros(len(angle))
    for e in effects:
        if e.effect.slug in ("transmission-error", "encoder-eccentricity") and e.place == (joint,):
            single = e.settings_map.get("order")
            for name, value in e.values.items():
                order = single if single is not None else float(name[1:])
                out += value * (np.sin if name[0] == "a" else np.cos)(order * angle)
    return out


def _compare(effects: dict[str, Sequence[PlacedEffect]], recordings: dict[str, Recording]) -> None:
    """Correlation of the two files' functions where both have data, orders 0 to 3 taken out there."""
    edges = np.deg2rad(np.arange(-360, 361))
    for k, joint in enumerate(("q1", "q2", "q3")):
        counts = [np.histogram(recordings[name].q[:, k], edges)[0] for name in FILES]
        both = (counts[0] >= 3) & (counts[1] >= 3)
        angle = ((edges[1:] + edges[:-1]) / 2)[both]
        low = np.column_stack(
            [f(o * angle) for o in range(1, LOW_ORDERS + 1) for f in (np.sin, np.cos)] + [np.ones(len(angle))]
        )
        curves = [_curve(effects[name], joint, angle) for name in FILES]
        left = [c - low @ np.linalg.lstsq(low, c, rcond=None)[0] for c in curves]
        r = float(np.corrcoef(left[0], left[1])[0, 1])
        say(
            f"{joint}: orders {LOW_ORDERS + 1} and above correlate {r:.3f} over {both.sum()} deg where both files have data"
        )


def _carry(
    machine_file: Path, effects: Sequence[PlacedEffect], source: Recording, target: Recording, label: str
) -> None:
    """Periodic terms of one file, fixed; the rest fitted to the other; position rms of its held-out rows."""
    machine = load_machine(machine_file)
    gear = [e for e in effects if e.effect.slug == "transmission-error" and "orders" in e.settings_map]
    whole = [replace(e, spread=0.0) for e in gear]
    high = [
        e.with_values([v if int(n[1:]) > LOW_ORDERS else 0.0 for n, v in e.values.items()]) for e in whole
    ]
    low = [PlacedEffect.at(e.effect, machine, e.place, {"orders": float(LOW_ORDERS)}) for e in gear]
    compliance = [e for e in effects if e.effect.slug == "joint-compliance"]
    for carried, refitted, what in (
        (whole, [], "all orders carried, geometry refitted"),
        (high, low, "orders 4 and above carried, geometry and orders 1-3 refitted"),
        (
            high,
            [*low, *compliance],
            "orders 4 and above carried, geometry, orders 1-3 and compliance refitted",
        ),
    ):
        terms = [*carried, *refitted]
        predictor = Predictor(machine, target, terms)
        start = predictor.model.p_home.copy()
        start[: len(machine.parameters)] = aligned_start(Predictor(machine, target))
        fit = estimate(machine, target, terms, start=start, predictor=predictor, loss="huber")
        rows = target.validation, target.validation & _visited(source, target)
        rms = [1000 * rms_by_kind(fit.residual[part], predictor.channels)["position"] for part in rows]
        say(f"{label}: {rms[0]:.0f} um held out, {rms[1]:.0f} um of it where the other file has data; {what}")


def _visited(source: Recording, target: Recording) -> np.ndarray:
    """Rows of ``target`` whose first five joints stand within a degree that ``source`` visited three times or more."""
    edges = np.deg2rad(np.arange(-361, 362))
    out = np.ones(len(target), dtype=bool)
    for k in range(5):
        counts = np.histogram(source.q[:, k], edges)[0]
        out &= counts[np.clip(np.digitize(target.q[:, k], edges) - 1, 0, len(counts) - 1)] >= 3
    return out


if __name__ == "__main__":
    if sys.argv[1] == "stewart":
        stewart(Path(sys.argv[2]))
    elif sys.argv[1] == "panda":
        panda(Path(sys.argv[2]), Path(sys.argv[3]))
    else:
        ur10(Path(sys.argv[2]), Path(sys.argv[3]))
