"""Fits the telescope in every model on every platform, prints the tables and draws the figures."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from joblib import Parallel, delayed
from telescope_models import charts, tables
from telescope_models.campaign import MODELS, measured
from telescope_models.fits import PLATFORMS, Outcome, against_elements, all_columns, calibrated
from telescope_models.relations import counts, flexure_sights, leg_sights, pivots

SEED = 20121009
"""The bundled demo's telescope; others take the next seeds."""
FIGURES = Path(__file__).resolve().parents[3] / "docs" / "figures"
ALL = (*MODELS, "elastic")
Numbers = tuple[float, float, float]


def main(arguments: list[str] | None = None, say: Callable[[str], object] = print) -> None:
    """The study; ``say`` takes its text."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=0, help="further telescopes for the spread of the numbers")
    parser.add_argument("-o", type=Path, default=FIGURES, help="folder of the figures")
    options = parser.parse_args(arguments)
    options.o.mkdir(parents=True, exist_ok=True)
    _one_telescope(options.o, say)
    if options.n:
        seeds = range(SEED + 10, SEED + 10 * (options.n + 1), 10)
        say(f"\n## Over {options.n} telescopes: mean (range)\n")
        say(_many([delayed(_numbers)(seed) for seed in seeds]))


def _one_telescope(folder: Path, say: Callable[[str], object]) -> None:
    shift = charts.parasitic_shift(folder)
    say(
        f"## Fig. 9, 1 deg: ball joint, eq. 12, exact arc, model: {[round(v, 4) for v in shift[-1].tolist()]} um"
    )
    with measured(SEED) as campaign:
        away = {model: round(um, 2) for model, um in against_elements(campaign, ALL).items()}
        say(f"\n## Tool against the simulator's flexures on a rigid platform, um at most: {away}")
        say(f"\n## kappa of eq. 1, 10^-3: {(1e3 * campaign.kappa).round(1).tolist()}; K of eq. 2, 10^-3:\n")
        say(str((1e3 * campaign.coefficients).round(1)))
        for objective in ("readings", "gaps", "whitened"):
            outcomes = [calibrated(campaign, m, p, objective) for p in PLATFORMS for m in ALL]
            say(f"\n## Objective: {objective}\n\n{tables.summary(outcomes, campaign.calibration)}")
            if objective == "readings":
                _of_readings(folder, outcomes, campaign.calibration, say)
        say(
            "\n## What cannot be told, leg 1\n\n"
            + tables.sights([*leg_sights(campaign, 1), *flexure_sights(campaign, 1)])
        )
        say("\n## Parameters that show\n")
        for model in ALL:
            say(f"- {model}: {counts(campaign, model)}")
        charts.columns(folder, {m: pivots(all_columns(campaign, m, full=False)) for m in ALL})
    with measured(SEED, ring_stiffness=float("inf")) as campaign:
        stiff = calibrated(campaign, "spherical", "rigid")
        say(
            f"\n## A rigid platform on ball joints: a, b off the drawing {tables.rms(stiff.points):.2f} mm rms\n"
        )


def _of_readings(
    folder: Path, outcomes: list[Outcome], calibration: charts.Mask, say: Callable[[str], object]
) -> None:
    say("\n" + tables.chosen_kinds(outcomes))
    for number, platform in zip((5, 6, 7), PLATFORMS, strict=True):
        for one in (o for o in outcomes if o.platform == platform and o.model in MODELS):
            say(f"\n### Table {number}, {one.model} model, platform {platform}\n\n{tables.deviations(one)}")
    reported = [o for o in outcomes if o.model in MODELS]
    charts.errors(folder, reported, calibration)
    charts.deviations(folder, reported)


def _numbers(seed: int) -> dict[tuple[str, str], Numbers]:
    out = {}
    with measured(seed) as campaign:
        for platform in PLATFORMS:
            for model in ALL:
                one = calibrated(campaign, model, platform)
                errors = (one.position[campaign.calibration], one.true_position[campaign.calibration])
                out[model, platform] = (
                    tables.rms(one.points),
                    float(errors[0].mean()),
                    float(errors[1].mean()),
                )
    return out


def _many(jobs: list[object]) -> str:
    results = Parallel(n_jobs=2)(jobs)
    return tables.over_telescopes({key: [one[key] for one in results] for key in results[0]})


if __name__ == "__main__":
    main()
