"""Identification from the nominal machine with truepose's general fit, judged by motions it never saw.

The truth (Tables II and III) enters through the simulated readings and through the judge only.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.problem import prior_of
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.sensors.distance import Distance

from .geometry import Constants, lengths, normals
from .plan import Motions, fresh_motions, paper_plan
from .recordings import ROUNDED, SIGMA, recording_text
from .reflection import mirror_poses
from .tables import DAY_0, NAMES, Tabled

Array = NDArray[np.float64]
BUNDLE = Path(__file__).resolve().parents[3] / "models" / "machines" / "nanopositioner"
TARGET_LENGTH, TARGET_ANGLE = 50.0, 0.004
"""nm and deg: the accuracy that the paper estimates."""
LEFT_BY_INTRINSICS = 0.5
"""um."""
FRESH = 500
FRESH_SEED = 2020


@dataclass(frozen=True)
class Score:
    """rms errors of predictions on fresh motions: nm of dL, deg of the normal's change, deg of the angle it turns.

    The change of the normal is a vector of the world; the angle between the normals of start and end does not
    depend on how the world's axes are laid.
    """

    length: float
    normal: float
    turned: float

    @property
    def better(self) -> bool:
        """Better than the paper's estimate in all."""
        return self.length < TARGET_LENGTH and max(self.normal, self.turned) < TARGET_ANGLE


def machine(sigma: float = SIGMA) -> Machine:
    """The bundled machine, its sensor's sigma (um) as given."""
    loaded = _bundled()
    sensors = tuple(replace(s, sigma=sigma * 1e-3) for s in loaded.sensors if isinstance(s, Distance))
    return replace(loaded, sensors=sensors)


@cache
def _bundled() -> Machine:
    return load_machine(BUNDLE / "machine.yaml")


def recorded(
    motions: Motions, points: int, table: Tabled = DAY_0, *, sigma: float = SIGMA, seed: int = 0
) -> Recording:
    """Simulated readings as truepose reads them from a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.csv"
        path.write_text(recording_text(motions, points, table, sigma=sigma, seed=seed), encoding="utf-8")
        return load_recording(_bundled(), [path])


def identify(recording: Recording, sigma: float = SIGMA) -> Estimate:
    """All constants under their tolerances, from nominal."""
    return estimate(machine(sigma), recording)


def identify_extrinsic(recording: Recording, known: Array | None = None) -> Estimate:
    """Extrinsics alone; intrinsic constants stay as in ``known`` (np,), by default nominal.

    The readings weigh with what wrong intrinsics leave in them; with the sensor's own sigma the valleys are too
    steep to be walked down.
    """
    nominal = machine(LEFT_BY_INTRINSICS)
    prior = prior_of(nominal)
    moving = np.isin(prior.names, list(NAMES.values()))
    prior = replace(prior, sigma=np.where(moving, prior.sigma, 0.0))
    return estimate(nominal, recording, prior=prior, start=known)


@cache
def fresh() -> tuple[Motions, Recording]:
    """500 motions over the ranges, the same in every study."""
    motions = fresh_motions(FRESH, np.random.default_rng(FRESH_SEED))
    return motions, recorded(motions, 1, sigma=0.0)


def score(p: Array, table: Tabled = DAY_0) -> Score:
    """Errors of the predictions of constants ``p`` (np,) on the fresh motions."""
    motions, recording = fresh()
    true = Constants.tabled(table)
    predictor = Predictor(machine(), recording)
    x, _ = predictor.assemble(p)
    names, values, _, poses = predictor.columns(p, x)
    change = values[1::2, names.index("dL")] - (lengths(true, motions.end) - lengths(true, motions.start))
    predicted = mirror_poses(machine(), poses, p)[:, :3, 2]
    start, end = normals(true, motions.start), normals(true, motions.end)
    wrong = (predicted[1::2] - predicted[::2]) - (end - start)
    turned = _angle(predicted[::2], predicted[1::2]) - _angle(start, end)
    return Score(
        1e6 * float(np.sqrt(np.mean(change**2))),
        float(np.degrees(np.sqrt(np.mean(np.sum(wrong**2, axis=1))))),
        float(np.degrees(np.sqrt(np.mean(turned**2)))),
    )


def _angle(one: Array, two: Array) -> Array:
    """(n,) rad between unit vectors; exact for small angles too."""
    return np.asarray(2 * np.arcsin(np.minimum(0.5 * np.linalg.norm(one - two, axis=1), 1.0)))


def nominal_score() -> Score:
    """What the drawing predicts."""
    return score(np.array([p.nominal for p in machine().parameters]))


def scores(points: int, sigma: float, seeds: Sequence[int]) -> list[Score]:
    """One identification from nominal for each seed of the noise (um), ``points`` readings a motion."""
    plan = paper_plan()
    return [score(identify(recorded(plan, points, sigma=sigma, seed=seed), sigma).p) for seed in seeds]


@dataclass(frozen=True)
class Line:
    """One line of the study's table: median and worst of each error over the draws, and how many are better."""

    points: int
    sigma: float
    draws: int
    median: Score
    worst: Score
    better: int


def line(points: int, sigma: float, draws: int) -> Line:
    """``draws`` identifications with ``points`` readings a motion and noise ``sigma`` um."""
    found = scores(points, sigma, range(draws))
    table = np.array([(s.length, s.normal, s.turned) for s in found])
    median, worst = Score(*np.median(table, axis=0)), Score(*np.max(table, axis=0))
    return Line(points, sigma, draws, median, worst, sum(s.better for s in found))


STUDY = (
    *((1, sigma, 20) for sigma in (0.001, 0.005, SIGMA, ROUNDED, 0.020, 0.050)),
    *((20, sigma, 20) for sigma in (SIGMA, ROUNDED, 0.050)),
    *((100, sigma, 20) for sigma in (SIGMA, ROUNDED, 0.050)),
    *((200, sigma, 10) for sigma in (SIGMA, ROUNDED)),
)
"""Readings a motion, noise in um, draws."""
STUDY_HEAD = (
    "readings a motion",
    "noise, nm",
    "dL, nm",
    "normal's change, deg",
    "angle turned, deg",
    "better than the paper",
)


def study_row(one: Line) -> list[str]:
    """A line of the table of benchmarks/results/nanopositioner.md: median (worst)."""

    def pair(name: str, digits: int) -> str:
        return f"{getattr(one.median, name):.{digits}f} ({getattr(one.worst, name):.{digits}f})"

    errors = [pair("length", 1), pair("normal", 4), pair("turned", 4)]
    return [str(one.points), f"{1e3 * one.sigma:.0f}", *errors, f"{one.better} of {one.draws}"]
