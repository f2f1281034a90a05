"""Makes the recordings of the golden diagnoses, always the same: ``python -m golden_diagnoses.make [CASE ...]``.

The simulated machines of the examination (``challenge.simulator``, ``challenge.mujoco``) measure; nothing that diagnoses is
used. Cases of MuJoCo's arms stay as they are where that is not installed. What is put into a case stands in ``cases.py``,
``rich.py`` and in ``tests/golden_diagnoses/README.md``, whose table is written from it; the files that a diagnosis reads do
not say. Afterwards ``pytest tests/kernel/identification/diagnosis/test_golden_diagnoses.py --update-golden``.
"""

from __future__ import annotations

import io
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from numpy.typing import NDArray

from challenge.nulls import Decoy, noisy
from challenge.simulator.base import Imperfection, SimulatedMachine
from challenge.simulator.registry import MACHINES
from challenge.simulator.writing import recording_text
from golden_diagnoses.cases import CASES as FEW
from golden_diagnoses.cases import Case
from golden_diagnoses.rich import RICH
from truepose.errors import InputError

Array = NDArray[np.float64]
HERE = Path(__file__).resolve().parents[2] / "tests" / "golden_diagnoses"
START, END = "<!-- written by make.py -->", "<!-- end -->"
CASES = (*FEW, *RICH)
MUJOCO = "mujoco-"
"""How the machines begin that MuJoCo moves."""
FINE = 100.0
"""Readings are written to a hundredth of their sigma or finer."""


def files(case: Case) -> dict[str, str]:
    """Texts of the files of a case by name."""
    machine = _machine(case.machine)
    specimen_rng, campaign_rng, shape_rng, noise_rng = (
        np.random.default_rng([case.seed, k]) for k in range(4)
    )
    decoy = Decoy(noise=case.noise, tolerance=case.tolerance, tails=case.tails)
    specimen = machine.specimen(specimen_rng, scale=decoy.tolerance)
    campaign = machine.campaign(case.plan, campaign_rng)
    exact = machine.measure(specimen, _imperfections(machine, case, shape_rng), campaign)
    readings = noisy(machine, exact, campaign, noise_rng, decoy)
    drawing = machine.machine_text()
    text = recording_text(machine, campaign, readings)
    table = _rounded(pd.read_csv(io.StringIO(text)), _decimals(machine, yaml.safe_load(drawing)))
    return {"machine.yaml": drawing, **_tables(table, case)}


def _machine(name: str) -> SimulatedMachine:
    """Raises InputError for an arm of MuJoCo's where that is not installed."""
    if not name.startswith(MUJOCO):
        return MACHINES[name]()
    from challenge.mujoco.arms import machines  # says what is missing where MuJoCo is not installed

    return machines()[name]()


def _imperfections(
    machine: SimulatedMachine, case: Case, rng: np.random.Generator
) -> tuple[Imperfection, ...]:
    """What is put in; sizes are multiples of what a shop would call usual."""
    usual = {kind.name: kind.typical for kind in machine.kinds()}
    return tuple(
        Imperfection(p.kind, p.place, p.size * usual[p.kind], dict(machine.shape(p.kind, p.place, rng)))
        for p in case.put_in
    )


def _decimals(
    machine: SimulatedMachine, drawing: Mapping[str, Mapping[str, Mapping[str, float]]]
) -> dict[str, int]:
    """Decimals of each sensor column."""
    finest = min(drawing["sensor"]["sigma"].values())
    return dict.fromkeys(machine.columns, int(np.ceil(np.log10(FINE / finest))))


def _rounded(table: pd.DataFrame, decimals: Mapping[str, int]) -> pd.DataFrame:
    return table.round(dict(decimals))


def _tables(table: pd.DataFrame, case: Case) -> dict[str, str]:
    """One file, or one for each session where these are not numbered."""
    kept = table.drop(
        columns=[c for c in map(str, table.columns) if {c, c.split(".")[0]} & set(case.withheld)]
    )
    if not case.split:
        return {"recording.csv": _csv(kept)}
    parts = sorted(set(table["session"]))
    return {f"recording{k}.csv": _csv(kept[table["session"] == k]) for k in parts}


def _csv(table: pd.DataFrame) -> str:
    """CSV, each number as short as it can be."""
    return str(table.to_csv(index=False, float_format=lambda value: f"{value:.10g}"))


def write(case: Case) -> None:
    """The files of a case; what is expected of it stays, and is updated by the test. Without MuJoCo its cases stay."""
    try:
        made = files(case)
    except InputError as exc:
        sys.stdout.write(f"{case.name} stays as it is: {exc}\n")
        return
    folder = HERE / case.name
    folder.mkdir(exist_ok=True)
    for stale in folder.glob("recording*.csv"):
        stale.unlink()
    for name, content in made.items():
        (folder / name).write_text(content, encoding="utf-8")


def table() -> str:
    """The table of README.md."""
    rows = [f"| {c.name} | {c.machine} | {c.told} | {c.why} |" for c in CASES]
    return "\n".join(["| case | machine | what was put in | why it is here |", "|---|---|---|---|", *rows])


def main(names: Sequence[str]) -> None:
    """Write the named cases (without names: all, and folders of no case go) and the table."""
    unknown = sorted(set(names) - {c.name for c in CASES})
    if unknown:
        raise SystemExit(
            f"found no case {', '.join(unknown)}, expected some of {', '.join(c.name for c in CASES)}"
        )
    for case in CASES:
        if not names or case.name in names:
            write(case)
    for folder in HERE.iterdir():
        if not names and (folder / "machine.yaml").is_file() and folder.name not in {c.name for c in CASES}:
            shutil.rmtree(folder)
    readme = HERE / "README.md"
    head, _, rest = readme.read_text(encoding="utf-8").partition(START)
    tail = rest.partition(END)[2]
    readme.write_text(f"{head}{START}\n\n{table()}\n\n{END}{tail}", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
