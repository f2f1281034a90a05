"""Numbers of results that are committed: a change of the numerics shows as a change of ``tests/golden_results``.

Laws say that a fit is right; these say that nothing has moved, before anything is drawn by chance. After a change that is
meant:

    pytest tests/whole/identification/test_golden_results.py --update-golden

writes what has changed anew; what then differs is for the reviewer.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
import pytest

from support import TESTS
from support.fleets import mixed_machines
from support.fringe_journeys import journey
from support.fringe_signal import FIBRE
from support.golden import differences
from support.golden_results import Json, calibrated, counted, is_same, kept, summed, weighed
from support.results import drifting
from truepose.identification.leaves.drift.words import drift_json
from truepose.identification.leaves.fringes.move import read_move

CASES, GOLDEN = TESTS / "golden_diagnoses", TESTS / "golden_results"
WEIGHED = (
    "arm-two", "arm-latency", "nanopositioner-two", "polisher-worn", "stewart-heat", "stewart-sessions", "telescope-two",
    "targets-outliers",
)  # fmt: skip
ESTIMATORS = ("map", "ols", "liu", "ridge", "pcr", "huber")
MOVES: Mapping[str, Json] = {
    "steady": {"seed": 1},
    "turning": {"seed": 2, "turning": True},
    "coarse": {"seed": 3, "samples": 8.0},
    "noisy": {"seed": 4, "noise": 0.02},
    "without scan": {"seed": 5, "scan": 0.0},
}


def _move(**light: float) -> Json:
    run = journey(**light)  # type: ignore[arg-type]
    return counted(read_move(run.t, run.signal, run.wavelength, FIBRE))


RESULTS: Mapping[str, Callable[[], Json]] = {
    **{f"weighed {case}": partial(weighed, CASES / case) for case in WEIGHED},
    **{f"calibrated {e}": partial(calibrated, CASES / "arm-quiet", e) for e in ESTIMATORS},
    **{f"move {name}": partial(_move, **light) for name, light in MOVES.items()},
    "drift": lambda: drift_json(drifting(0.2)),
    "fleet": lambda: summed(mixed_machines(np.random.default_rng(1), 60)),
}


@pytest.mark.parametrize("name", RESULTS)
def test_numbers_are_as_committed(name: str, request: pytest.FixtureRequest) -> None:
    new = kept(RESULTS[name]())
    file = GOLDEN / f"{name.replace(' ', '_')}.json"
    old = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None
    found = list(differences(old, new, is_same))
    if found and request.config.getoption("--update-golden"):
        file.write_text(json.dumps(new, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        return
    told = "\n".join(f"- {said}" for said in found[:20])
    assert not found, f"{file.relative_to(TESTS)} (pytest --update-golden, if this is meant):\n{told}"


def test_no_golden_is_left_over() -> None:
    assert {file.stem for file in GOLDEN.glob("*.json")} == {name.replace(" ", "_") for name in RESULTS}
