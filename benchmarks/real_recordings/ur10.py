"""UR10 with a laser tracker: both files diagnosed, their periodic functions compared and carried over."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from real_recordings.common import FILES, HELD_OUT, say
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.summary import rms_by_kind
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.load import load_machine

LOW_ORDERS = 3


def mark_held_out(data: Path, work: Path, names: Sequence[str] = FILES) -> None:
    """Copies of files in ``work`` with a column ``role``."""
    for name in names:
        table = pd.read_csv(data / "ur10-laser-tracker" / f"{name}.csv")
        table["role"] = np.where(np.isin(table["goal"] % 10, HELD_OUT), "validation", "calibration")
        table.to_csv(work / f"{name}.csv", index=False)


def ur10(data: Path, work: Path) -> None:
    """Diagnose both files, then compare them."""
    machine = data / "ur10-laser-tracker" / "machine.yaml"
    work.mkdir(parents=True, exist_ok=True)
    mark_held_out(data, work)
    for name in FILES:
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
