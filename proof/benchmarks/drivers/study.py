"""One machine of the study, simulated, diagnosed and judged."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from drivers import hexapod
from drivers.warmth import STEP, Bar, duty_of
from numpy.typing import NDArray

import truepose
from support import plain_arm as arm
from support.plain_arm import soft_arm
from truepose.identification.diagnosis.result import Diagnosis

Array = NDArray[np.float64]
ROWS, SECONDS = 60, 6 * 3600.0
BESIDE = {"link2": ("link3", "q3.d"), "link4": ("link5", "q4.r")}
"""Links that are heated: who has the thermometer, and the length that grows."""


@dataclass(frozen=True)
class Judged:
    """seed, what was put in, whether place and driver, and the law, were named; what was said, and errors of coefficients in
    their 1-sigma."""

    seed: int
    put: str
    place: bool
    law: bool
    said: str
    errors: tuple[float, ...] = ()


def heated(seed: int) -> Judged:
    """A leg or a link warms up; thermometers sit beside another one and on the base."""
    rng = np.random.default_rng(seed)
    machine, table, part = (_heated_leg if seed % 2 else _heated_link)(rng)
    found = diagnosed(machine, table)
    return _judged(seed, found, {part}, "temperature", "thermal-expansion")


def soft(seed: int) -> Judged:
    """One joint or two give way; torques are measured, of either sign, and nobody says what the tool carries."""
    machine, table, c, _ = soft_arm(seed)
    found = diagnosed(machine, table)
    errors = []
    for finding in found.findings:
        if finding.effect == "joint-compliance" and finding.place[0] in c and len(finding.parameters) == 1:
            (value,) = finding.parameters.values()
            errors.append((value.value - c[finding.place[0]]) / value.std)
    return _judged(seed, found, set(c), "load", "joint-compliance", tuple(errors))


def _judged(seed: int, found: Diagnosis, parts: set[str], kind: str, law: str, errors: Any = ()) -> Judged:
    sure = [f for f in found.findings if f.levels.place > 0.5 and f.levels.driver > 0.5]
    at = {(p, f.levels.kind) for f in sure for p in f.place}
    named = {p for f in found.findings if f.effect == law and f.probability > 0.5 for p in f.place}
    said = [f"{f.effect}@{'+'.join(f.place)} {f.levels.kind} {f.probability:.2f}" for f in found.findings]
    right = at == {(part, kind) for part in parts}
    return Judged(
        seed, ", ".join(sorted(parts)), right, named == parts, "; ".join(said) or found.verdict, errors
    )


def diagnosed(document: dict[str, Any], table: pd.DataFrame) -> Diagnosis:
    with tempfile.TemporaryDirectory() as folder:
        file, rows = Path(folder) / "machine.yaml", Path(folder) / "rows.csv"
        file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
        table.to_csv(rows, index=False)
        machine = truepose.load_machine(file)
        return truepose.diagnose(machine, truepose.load_recording(machine, [rows]))


def _warmth(rng: np.random.Generator, length: float) -> tuple[Array, Array, Array, Array]:
    """Times (n,) of the rows, and temperatures there: of the part, of the thermometer beside it, of the air."""
    duty = duty_of(rng, SECONDS)
    clock = STEP * np.arange(len(duty))
    air = 21.0 + rng.uniform(0.5, 2.0) * np.sin(
        2 * np.pi * clock / 86400 * rng.uniform(0.7, 2.0) + rng.uniform(0, 6)
    )
    part, beside = Bar.drawn(rng, length).history(duty, air, float(air[0]))
    at = np.sort(rng.choice(len(clock), ROWS, replace=False))
    noise = rng.normal(scale=0.05, size=(2, ROWS))
    return (
        np.asarray(clock[at], dtype=np.float64),
        part[at],
        beside[at] + noise[0] + rng.uniform(-1.0, 1.0),
        air[at] + noise[1],
    )


def _heated_link(rng: np.random.Generator) -> tuple[dict[str, Any], pd.DataFrame, str]:
    part = str(rng.choice(list(BESIDE)))
    beside, name = BESIDE[part]
    true, alpha = arm.constants(rng), rng.uniform(1.1e-5, 2.3e-5)
    time, own, other, air = _warmth(rng, true[name] / 1000.0)
    rows = []
    for k in range(ROWS):
        q = rng.uniform(arm.LOW, arm.HIGH)
        warm = {**true, name: true[name] * (1 + alpha * (own[k] - 20.0))}
        row = {"time": time[k], **dict(zip(arm.JOINTS, q, strict=True))}
        row |= {f"temperature.{beside}": other[k], "temperature.base": air[k]}
        rows.append(row | arm.readings(warm, np.radians(q), rng))
    return arm.document(weighs=False), pd.DataFrame(rows), part


def _heated_leg(rng: np.random.Generator) -> tuple[dict[str, Any], pd.DataFrame, str]:
    leg, step = int(rng.integers(6)), int(rng.integers(1, 6))
    a = hexapod.BASE + rng.normal(scale=hexapod.LENGTH, size=(6, 3))
    b = hexapod.PLATFORM + rng.normal(scale=hexapod.LENGTH, size=(6, 3))
    home = hexapod.HOME + rng.normal(scale=hexapod.LENGTH, size=6)
    alpha = rng.uniform(1.1e-5, 2.3e-5)
    time, own, other, air = _warmth(rng, float(home[leg]) / 1000.0)
    rows = []
    for k in range(ROWS):
        rho = rng.uniform(-60.0, 60.0, 6)
        lengths = home + rho
        lengths[leg] *= 1 + alpha * (own[k] - 20.0)
        row = {"time": time[k], **{f"rho{n + 1}": rho[n] for n in range(6)}}
        row |= {f"temperature.leg{(leg + step) % 6 + 1}": other[k], "temperature.base": air[k]}
        rows.append(row | hexapod.readings(a, b, lengths, rng))
    return hexapod.document(), pd.DataFrame(rows), f"leg{leg + 1}"


__all__ = ["Judged", "diagnosed", "heated", "soft"]
