"""What the prior learned from 100 machines does for the names of 100 others of the same fleet.

    python -m benchmarks.fleet_prior draw FOLDER [--seed 1]   # 200 machines as files, and apart from them the truth
    python -m benchmarks.fleet_prior sit FOLDER               # 300 diagnoses, one after the other; goes on where it stopped
    python -m benchmarks.fleet_prior table FOLDER -o benchmarks/results/fleet_prior.md

`--learn N --judge N` of ``sit`` and ``table`` take fewer: each diagnosis takes 4 to 10 s of one core.

Machines are arms of ``challenge/simulator``, which computes its physics by other means than the catalogue's. How often a fleet
has an effect at a place, and how large, is drawn once for the fleet and never told: two effects have a weak place (30 to 50 %
of machines), five are rare (1 to 4 % at each place), others never occur; sizes scatter by 1.5 about the fleet's median. ``sit``
reads ``FOLDER/machines`` alone; the truth is in ``FOLDER/truth.json``.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import truepose
from challenge.simulator.arm import Arm
from challenge.simulator.base import Imperfection, Kind, Plan
from challenge.simulator.writing import recording_text
from truepose.files import atomic_write_text
from truepose.identification.learned_prior import read_prior
from truepose.identification.leaves.fleet.evidence import evidence, kept
from truepose.identification.leaves.fleet.learn import learned, write_prior
from truepose.identification.leaves.fleet.pooled import Pooled
from truepose.identification.leaves.fleet.statistics import EffectInFleet, statistics

Array = NDArray[np.float64]
LEARN, JUDGE = 100, 100
PLAN = Plan(poses=30, repeats=2)
FREQUENT, RARE = 2, 5
"""Kinds with a weak place, and kinds that are rare everywhere; all others never occur."""
LEAST = 1e-4
"""Probability that the scores count at least, for what is there and what is not."""
BINS = ((0.5, 0.8), (0.8, 0.95), (0.95, 1.01))
WITHOUT, WITH = "default", "learned"


def fleet(rng: np.random.Generator) -> list[dict[str, Any]]:
    """Kinds at places with their frequency in the fleet and median size: the hyper-parameters."""
    kinds, out = _kinds(), list[dict[str, Any]]()
    for number, k in enumerate(rng.permutation(len(kinds))):
        kind = kinds[k]
        median = kind.typical * float(np.exp(rng.uniform(np.log(0.4), np.log(2.5))))
        weak = int(rng.integers(len(kind.places)))
        for at, place in enumerate(kind.places):
            frequent = number < FREQUENT and at == weak
            q = rng.uniform(0.3, 0.5) if frequent else rng.uniform(0.01, 0.04)
            frequency = float(q) if number < FREQUENT + RARE else 0.0
            own = {"kind": kind.name, "slug": kind.slug, "place": list(place), "frequency": frequency}
            out.append({**own, "median": median})
    return out


def _kinds() -> list[Kind]:
    """Kinds with a name that one session at rest shows."""
    away = ("velocity", "session")
    return [
        k
        for k in Arm().kinds()
        if k.slug not in ("", "outlier", "outliers") and not any(n.startswith(away) for n in k.needs)
    ]


def draw(folder: Path, seed: int) -> None:
    """Write machines and, apart from them, the truth."""
    arm, rng = Arm(), np.random.default_rng(seed)
    drawn, machines = fleet(rng), list[list[list[Any]]]()
    for number in range(LEARN + JUDGE):
        rng = np.random.default_rng([seed, number])
        there = [one for one in drawn if rng.random() < one["frequency"]]
        specimen, campaign = arm.specimen(rng), arm.campaign(PLAN, rng)
        imperfections = tuple(_imperfection(arm, one, rng) for one in there)
        read = arm.noisy(arm.measure(specimen, imperfections, campaign), campaign, rng)
        own = folder / "machines" / f"{number:03d}"
        own.mkdir(parents=True, exist_ok=True)
        atomic_write_text(own / "machine.yaml", arm.machine_text())
        atomic_write_text(own / "recording.csv", recording_text(arm, campaign, read))
        machines.append([[one["slug"], one["place"]] for one in there])
    atomic_write_text(folder / "truth.json", json.dumps({"fleet": drawn, "machines": machines}))


def _imperfection(arm: Arm, one: Mapping[str, Any], rng: np.random.Generator) -> Imperfection:
    place = tuple(one["place"])
    size = one["median"] * float(np.exp(0.4 * rng.standard_normal()))
    return Imperfection(one["kind"], place, size, dict(arm.shape(one["kind"], place, rng)))


@dataclass(frozen=True)
class Study:
    """Where it is, and how many machines are learned from and judged."""

    folder: Path
    learn: int = LEARN
    judge: int = JUDGE

    @property
    def prior(self) -> Path:
        """The file that was learned."""
        return self.folder / f"prior-{self.learn:03d}.yaml"

    @property
    def judged(self) -> list[int]:
        """Machines that were diagnosed with both priors."""
        every = range(LEARN, LEARN + self.judge)
        return [k for k in every if self.result(k, WITHOUT).is_file() and self.result(k, WITH).is_file()]

    def result(self, number: int, prior: str) -> Path:
        """The file of a diagnosis."""
        name = f"{prior}-{self.learn:03d}" if prior == WITH else prior
        return self.folder / "results" / name / f"{number:03d}.json"

    def read(self, number: int, prior: str) -> dict[str, Any]:
        """What a diagnosis said."""
        return dict(json.loads(self.result(number, prior).read_text(encoding="utf-8")))

    def pooled(self) -> Pooled:
        """Of those to learn from."""
        return Pooled.of([self.read(number, WITHOUT)["kept"] for number in range(self.learn)])


def sit(study: Study) -> None:
    """Diagnose: those to learn from, then the prior, then the others without it and with it."""
    for number in range(study.learn):
        _diagnosed(study, number, WITHOUT)
    if not study.prior.is_file():
        write_prior(study.prior, learned(study.pooled()))
    for number in range(LEARN, LEARN + study.judge):
        _diagnosed(study, number, WITHOUT)
        _diagnosed(study, number, WITH)


def _diagnosed(study: Study, number: int, prior: str) -> None:
    file, own = study.result(number, prior), study.folder / "machines" / f"{number:03d}"
    if file.is_file():
        return
    machine = truepose.load_machine(own / "machine.yaml")
    known = read_prior(study.prior) if prior == WITH else None
    found = truepose.diagnose(machine, own / "recording.csv", prior=known, examine=evidence)
    names = [[f.effect, list(f.place), f.probability] for f in found.findings]
    file.parent.mkdir(parents=True, exist_ok=True)
    atomic_write_text(file, json.dumps({"kept": kept(found), "names": names, "verdict": found.verdict}))
    sys.stdout.write(f"{prior} {number}: {found.verdict}, {len(names)} names\n")
    sys.stdout.flush()


@dataclass(frozen=True)
class Scores:
    """Of one prior: log score and Brier score of each machine (m,), probabilities of names that were said and whether they are
    right (n,), and names right, false and missed."""

    log: Array
    brier: Array
    said: Array
    right: Array
    missed: int


def scores(study: Study, truth: list[list[list[Any]]], prior: str) -> Scores:
    """Of the machines to judge."""
    log, brier, said, right, missed = list[float](), list[float](), list[float](), list[bool](), 0
    for number in study.judged:
        result = study.read(number, prior)
        there = {(slug, "+".join(place)) for slug, place in truth[number]}
        told = {
            (slug, place): float(one[0])
            for slug, own in result["kept"]["places"].items()
            if slug != "empirical"
            for place, one in own.items()
        }
        p = np.array([told.get(name, 0.0) for name in {*told, *there}])
        is_there = np.array([name in there for name in {*told, *there}])
        counted = np.clip(p, LEAST, 1.0 - LEAST)
        log.append(float(-np.sum(np.log(np.where(is_there, counted, 1.0 - counted)))))
        brier.append(float(np.sum((p - is_there) ** 2)))
        names = {(n[0], "+".join(n[1])): n[2] for n in result["names"] if n[0] != "empirical" and n[2] >= 0.5}
        said += names.values()
        right += [name in there for name in names]
        missed += len(there - names.keys())
    return Scores(np.array(log), np.array(brier), np.array(said), np.array(right, dtype=bool), missed)


def table(study: Study) -> str:
    """The page of results."""
    truth = json.loads((study.folder / "truth.json").read_text(encoding="utf-8"))
    without, with_ = (scores(study, truth["machines"], prior) for prior in (WITHOUT, WITH))
    lines = [
        f"# A prior learned from {study.learn} machines, on {len(study.judged)} others",
        "",
        *_head(study),
        "",
        f"| of {len(study.judged)} machines | default prior | learned prior |",
        "|---|---|---|",
        *(f"| {name} | {of(without)} | {of(with_)} |" for name, of in _rows().items()),
        "",
        f"Log score, default less learned: {_paired(without.log - with_.log)} a machine;"
        f" Brier score: {_paired(without.brier - with_.brier)} (mean, 95 % of paired differences' mean).",
        "",
        *_frequencies(study, truth["fleet"]),
    ]
    return "\n".join(lines) + "\n"


def _head(study: Study) -> list[str]:
    fewer = (
        f" --learn {study.learn} --judge {study.judge}"
        if (study.learn, study.judge) != (LEARN, JUDGE)
        else ""
    )
    return [
        "Simulated arms of one fleet (`challenge/simulator`), 60 rows each. Frequencies and median sizes of effects were drawn",
        "once, and only the simulator knows them. Made by",
        "",
        "    python -m benchmarks.fleet_prior draw FOLDER --seed 3",
        f"    python -m benchmarks.fleet_prior sit FOLDER{fewer}",
        f"    python -m benchmarks.fleet_prior table FOLDER{fewer} -o benchmarks/results/fleet_prior.md",
        "",
        "Scores are of every effect of the catalogue at every place (lower is better; probabilities are counted from 1e-4 to",
        "1 - 1e-4), names are those said with 0.5 or more.",
    ]


def _rows() -> dict[str, Any]:
    reliability = {
        f"said with {low:g} to {min(high, 1.0):g}: right": partial(_within, low=low, high=high)
        for low, high in BINS
    }
    return {
        "log score a machine": lambda s: f"{s.log.mean():.3f}",
        "Brier score a machine": lambda s: f"{s.brier.mean():.4f}",
        "names right": lambda s: int(s.right.sum()),
        "names false": lambda s: int((~s.right).sum()),
        "effects missed": lambda s: s.missed,
        **reliability,
    }


def _within(s: Scores, low: float, high: float) -> str:
    at = (s.said >= low) & (s.said < high)
    share = f" ({s.right[at].mean():.0%}, said {s.said[at].mean():.0%})" if at.any() else ""
    return f"{int(s.right[at].sum())} of {int(at.sum())}{share}"


def _paired(difference: Array) -> str:
    half = 1.96 * float(difference.std(ddof=1)) / np.sqrt(len(difference))
    return f"{difference.mean():+.4f} ± {half:.4f}"


def _frequencies(study: Study, drawn: list[dict[str, Any]]) -> Iterator[str]:
    """Learned beside drawn, with how many intervals hold what was drawn."""
    told = {(one.effect, one.place): one for one in statistics(study.pooled()).places}
    pairs = [(one, told.get((one["slug"], tuple(one["place"])))) for one in drawn]
    known = [(one, found) for one, found in pairs if found is not None]
    yield from ("## Frequencies, learned and drawn", "")
    yield "| places that were drawn as | places | mean drawn | mean learned | 90 % intervals that hold what was drawn |"
    yield "|---|---|---|---|---|"
    for name, low, high in (("frequent", 0.2, 1.0), ("rare", 1e-9, 0.2), ("never", -1.0, 1e-9)):
        own = [(one["frequency"], found) for one, found in known if low <= one["frequency"] < high]
        if not own:
            continue
        held = f"{sum(_holds(q, f) for q, f in own)} of {len(own)}"
        if name == "never":
            held = f"upper ends up to {max(f.frequency.high for _, f in own):.3f}"
        means = np.mean([q for q, _ in own]), np.mean([f.frequency.value for _, f in own])
        yield f"| {name} | {len(own)} | {means[0]:.3f} | {means[1]:.3f} | {held} |"
    yield from ("", "| effect at a weak place | drawn | learned | expected before |", "|---|---|---|---|")
    for one, found in known:
        if one["frequency"] > 0.2:
            f = found.frequency
            name = f"{one['slug']}, {'+'.join(one['place'])}"
            yield f"| {name} | {one['frequency']:.2f} | {f.value:.2f} ({f.low:.2f} to {f.high:.2f}) | {found.usual:.3f} |"
    yield from (
        "",
        "What no recording of such a plan shows (a scale of the sensor that the machine's lengths swallow) stays at what was",
        "expected before, and its interval is that of the prior.",
    )


def _holds(q: float, found: EffectInFleet) -> bool:
    return found.frequency.low <= q <= found.frequency.high


def main() -> None:
    """See above."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("command", choices=("draw", "sit", "table"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--learn", type=int, default=LEARN)
    parser.add_argument("--judge", type=int, default=JUDGE)
    parser.add_argument("-o", dest="output", type=Path)
    given = parser.parse_args()
    study = Study(given.folder, min(given.learn, LEARN), min(given.judge, JUDGE))
    if given.command == "draw":
        draw(given.folder, given.seed)
    elif given.command == "sit":
        sit(study)
    else:
        text = table(study)
        atomic_write_text(given.output, text) if given.output else sys.stdout.write(text)


if __name__ == "__main__":
    main()
