"""What a diagnosed model is worth on rows that it has not seen: one table row and the names for each recording."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from real_recordings.prepared import NAMES, prepared

import truepose
from truepose.identification.diagnosis.result import Diagnosis, Finding

STATED = 0.5
HEADER = "| recording | verdict | held out, plain | with what was found | tool, plain -> applied | z, inside 1.96 |"
TIMES_95 = 1.96


def unseen(data: Path, work: Path, names: Sequence[str] = ()) -> Iterator[str]:
    """Lines of the table; each diagnosis stays in a folder of ``work``."""
    yield HEADER
    yield "|---|---|---|---|---|---|"
    for name in names or NAMES:
        yield from _told(name, diagnosed(data, work, name), work)


def diagnosed(data: Path, work: Path, name: str) -> Diagnosis:
    """As ``truepose diagnose`` has it, with ``improved.yaml`` and the report."""
    machine, recording = prepared(data, work, name)
    sys.stderr.write(f"{name}\n")
    found = truepose.diagnose(truepose.load_machine(machine), recording)
    found.write(work / name)
    return found


def _told(name: str, found: Diagnosis, work: Path) -> Iterator[str]:
    before, after = (found.fits[stage].validation_rms or {} for stage in ("before", "after"))
    held = [", ".join(_length_or_angle(*item) for item in rms.items()) for rms in (before, after)]
    pose = found.applied.pose if found.applied else None
    tool = "-" if pose is None else f"{pose.plain:.3f} -> {pose.model:.3f} mm"
    yield f"| {name} | {found.verdict} | {held[0]} | {held[1]} | {tool} | {_scores(found, work / name)} |"
    for finding in found.findings:
        if max(finding.probability, finding.levels.driver) >= STATED:
            yield f"  {_named(finding)}"


def _length_or_angle(kind: str, value: float) -> str:
    """An rms in mm, or in µrad where it is of angles."""
    return f"{value:.3f} mm" if kind == "position" else f"{1e6 * value:.0f} µrad"


def _scores(found: Diagnosis, folder: Path) -> str:
    """Held-out errors over the sigma that ``truepose predict`` and the sensor state together, by ``improved.yaml``."""
    machine = truepose.load_machine(folder / "improved.yaml")
    frame = truepose.predict(machine, found.recording)
    rows, z = found.recording.validation, []
    for sensor in machine.sensors:
        for channel in sensor.channels:
            read = found.recording.observations.get(channel.name)
            if channel.kind != "position" or read is None or channel.name not in frame:
                continue
            std = np.hypot(frame[f"{channel.name}.std"], channel.sigma)
            z.append(((read - frame[channel.name]) / std).to_numpy()[rows])
    if not z:
        return "-"
    scores = np.concatenate(z)
    return f"{np.sqrt(np.mean(scores**2)):.2f}, {100 * np.mean(np.abs(scores) < TIMES_95):.0f} %"


def _named(finding: Finding) -> str:
    """Its law, place and driver with their probabilities, amounts, and whether halves of the rows agree."""
    levels, halves = finding.levels, finding.replication
    amounts = ", ".join(f"{n} {q.value:.4g} ± {q.std:.2g} {q.unit}" for n, q in finding.parameters.items())
    said = (
        f"{finding.effect} {'+'.join(finding.place)}: law {finding.probability:.2f}, place {levels.place:.3f}"
    )
    agreed = "" if halves is None else f"; halves {halves.halves[0]:.2f}, {halves.halves[1]:.2f}"
    return f"{said}, {levels.kind} {levels.driver:.3f}{agreed}" + (
        f"; {amounts}" if len(amounts) < 200 else ""
    )
