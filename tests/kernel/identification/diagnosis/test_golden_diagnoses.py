"""Small recordings whose diagnoses are committed: a change of the engine shows as a change of ``tests/golden_diagnoses``.

Each case is a machine file, one recording or more, and ``expected.json``: verdict, names, classes, probabilities,
fitted sizes, proof (support.golden_diagnoses). The recordings come from simulated machines (README.md there says what
was put in; the engine does not read it). After a change that is meant:

    pytest tests/kernel/identification/diagnosis/test_golden_diagnoses.py --update-golden

writes what is expected anew where it has changed; what then differs is for the reviewer.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import truepose
from support import TESTS
from support.golden_diagnoses import changes, summary, text
from support.reports import diagnosis_lines
from support.round_trips import check_round_trip
from truepose.identification.diagnosis.result import Diagnosis
from truepose.models.machine.placed import EffectAtPlace
from truepose.shown.text import LINES, WIDTH

GOLDEN = TESTS / "golden_diagnoses"
CASES = sorted(file.parent.name for file in GOLDEN.glob("*/machine.yaml"))
BY_DAY = ("arm-two", "nanopositioner-two", "polisher-leg", "targets-outliers")
"""An arm, a stage, a hybrid machine, and a telescope without a fault but for single rows; the night has all."""


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=() if case in BY_DAY else pytest.mark.nightly) for case in CASES]
)
def test_diagnosis_is_as_committed(case: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """What it says is what is committed, and the machine that it writes is read and generated as the same machine."""
    folder = GOLDEN / case
    machine = truepose.load_machine(folder / "machine.yaml")
    recording = truepose.load_recording(machine, sorted(folder.glob("*.csv")))
    found_here = truepose.diagnose(machine, recording)
    lines = diagnosis_lines(found_here, Path("out"))
    shown = [line for line in lines if not line.startswith("next")]
    assert len(lines) <= LINES and max(map(len, shown)) <= WIDTH and machine.name in lines[0]
    check_sizes(found_here)
    check_round_trip(found_here, tmp_path)
    document = truepose.diagnosis_json(found_here)
    assert document["judgement"] == {"calibrated": True, "why": []}
    new = summary(document)
    file = folder / "expected.json"
    old = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None
    found = ["nothing is committed yet"] if old is None else changes(old, new)
    if found and request.config.getoption("--update-golden"):
        file.write_text(text(new), encoding="utf-8")
        return
    told = "\n".join(f"- {said}" for said in found)
    assert not found, f"tests/golden_diagnoses/{case} (pytest --update-golden, if this is meant):\n{told}"


def check_sizes(found: Diagnosis) -> None:
    """What is more probable than not has the size in ``improved.yaml`` that its finding has, to two of its own sigmas."""
    deployed = {e.at_place: e for e in found.after.fitted_effects()}
    for one in found.findings:
        effect = deployed.get(EffectAtPlace(one.effect, one.place))
        if one.probability <= 0.5 or effect is None or len(one.settings) > 1:
            continue
        for name, quantity in one.parameters.items():
            assert abs(quantity.value - effect.values[name]) <= 2.0 * quantity.std
