"""The public functions of recordings: files, DataFrames and results become recordings and machines here, and nowhere below."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

from truepose.identification.compensation import compensate as compensation
from truepose.identification.diagnosis import diagnose as engine
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit import calibrate as calibration
from truepose.identification.fit import estimate as fitting
from truepose.identification.identifiability import analysis
from truepose.identification.identifiability.analysis import SEED
from truepose.identification.learned_prior import LearnedPrior, read_prior
from truepose.identification.prediction import predict as prediction
from truepose.identification.recording.load import Sources, as_recording
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine, MachineLike, as_machine

P = ParamSpec("P")
T = TypeVar("T")


def of_sources(
    work: Callable[Concatenate[Machine, Recording, P], T], *, need_observations: bool = True
) -> Callable[Concatenate[MachineLike, Recording | Sources, P], T]:
    """Return the function for machines and recordings that are given in any form."""

    @wraps(work)
    def run(machine: MachineLike, recording: Recording | Sources, /, *more: P.args, **options: P.kwargs) -> T:
        machine = as_machine(machine)
        rows = as_recording(machine, recording, need_observations=need_observations)
        return work(machine, rows, *more, **options)

    return run


calibrate = of_sources(calibration.calibrate)
compensate = of_sources(compensation.compensate, need_observations=False)
estimate = of_sources(fitting.estimate)
predict = of_sources(prediction.predict, need_observations=False)
simulate = of_sources(prediction.simulate, need_observations=False)


@wraps(engine.diagnose)
def diagnose(
    machine: MachineLike,
    recording: Recording | Sources,
    *,
    prior: LearnedPrior | Path | str | None = None,
    progress: Callable[[str], None] = lambda _: None,
    stop: Callable[[], bool] = lambda: False,
    examine: engine.Examine | None = None,
) -> Diagnosis:
    machine = as_machine(machine)
    learned = read_prior(prior) if isinstance(prior, Path | str) else prior
    return engine.diagnose(
        machine,
        as_recording(machine, recording),
        prior=learned,
        progress=progress,
        stop=stop,
        examine=examine,
    )


@wraps(analysis.identifiability)
def identifiability(
    machine: MachineLike,
    recording: Recording | Sources | None = None,
    *,
    poses: int = analysis.DRAWN_POSES,
    machines: int = analysis.DRAWN_MACHINES,
    seed: int = SEED,
) -> analysis.Identifiability:
    machine = as_machine(machine)
    rows = None if recording is None else as_recording(machine, recording, need_observations=False)
    return analysis.identifiability(machine, rows, poses=poses, machines=machines, seed=seed)


__all__ = [
    "calibrate",
    "compensate",
    "diagnose",
    "estimate",
    "identifiability",
    "of_sources",
    "predict",
    "simulate",
]
