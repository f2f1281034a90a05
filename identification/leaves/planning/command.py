"""``plan``: measurement poses that calibrate a machine best, or rows that tell explanations apart."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from truepose.commands.common import FileOption, JsonOption, MachineArg, check_file, finish, options, progress
from truepose.errors import InputError
from truepose.files import mixture_notes, write_table
from truepose.models.file.limits import POSES
from truepose.wording import joined

if TYPE_CHECKING:
    import pandas as pd

    from truepose.arrays import Array
    from truepose.models.machine.machine import Machine

    Planned = tuple[pd.DataFrame, str, list[str], dict[str, Any], list[str]]
    """A table, its heading, lines of the answer, the same as data, and notes."""


@options(
    n=("-n --poses N: How many poses.", {"min": 2, "max": POSES}),
    seed=("--seed: Seed of the random candidates.", {"min": 0}),
    method="continuous|exchange|random: Move all poses at once, exchange them, or draw them (default: continuous; with "
    "candidates, exchange).",
    candidates="FILE: Choose among these joint values (free of collisions, say), by exchange.",
    discriminate="A B: Poses that tell two explanations apart, SLUG@PLACE[:name=value[unit],...] each, as simulate names "
    "effects.",
    rival="C: A further explanation; repeatable. The worst pair counts.",
    diagnosis="FILE: diagnosis.json: split the class of its finding, at its fitted value.",
    payload="0,2.5,5: Payloads that can be carried, kg.",
    temperature="PLACE=15,20,30: Temperatures a place can be held at, degC; repeatable (air: every place alike).",
    vary="DRIVER=...: Levels of another driver (pressure in hPa, velocity.JOINT in mm/s or rad/s); repeatable.",
    recorded="--with RECORDING: Rows measured already, to be added to; repeatable.",
)
def plan(
    machine: MachineArg,
    n: int,
    output: FileOption,
    method: str = "",
    seed: int = 0,
    candidates: Path | None = None,
    discriminate: tuple[str, str] | None = None,
    rival: list[str] | None = None,
    diagnosis: Path | None = None,
    payload: str = "",
    temperature: list[str] | None = None,
    vary: list[str] | None = None,
    recorded: list[Path] | None = None,
    as_json: JsonOption = False,
) -> None:
    """Measurement poses that calibrate best: joint values inside their ranges, before anything is measured.

    With --discriminate: rows (poses, payload, temperatures, sides) that tell explanations apart.

    The constants are those of the machine file that have a tolerance, its effects included. Collisions and
    lines of sight are not known: give --candidates where they matter.

    Example: truepose plan machine.yaml -n 40 -o poses.csv

    Example: truepose plan machine.yaml -n 40 -o poses.csv --diagnosis result/diagnosis.json --payload 0,2.5,5
    """
    from truepose.identification.recording.load import load_recording
    from truepose.models.load import load_machine

    names = (*(discriminate or ()), *(rival or ()))
    varied = (*(f"temperature.{text}" for text in temperature or ()), *(vary or ()))
    exist, is_experiment = tuple(recorded or ()), bool(names) or diagnosis is not None
    if (payload or varied or exist) and not is_experiment:
        raise InputError(
            "--payload, --temperature, --vary and --with: found without --discriminate A B or --diagnosis FILE, expected "
            "explanations to tell apart"
        )
    if is_experiment and method not in ("", "exchange"):
        raise InputError(
            "--method: found with --discriminate, expected none: rows are exchanged for the expected log Bayes factor"
        )
    check_file(output, machine, candidates, diagnosis, *exist)
    with progress("planning") as say:
        known = load_machine(machine)
        given = (
            load_recording(known, [candidates], need_observations=False).q if candidates is not None else None
        )
        if is_experiment:
            offered = payload, varied, exist
            planned = _tell_apart(known, n, names, diagnosis, offered, given, seed, say)
        else:
            planned = _calibrate(known, n, method, given, seed, say)
    frame, heading, lines, told, notes = planned
    write_table(output, frame, [f"{heading}, seed {seed}", *lines])
    summary = {"command": "plan", **told, "files": [str(output)]}
    count = f"{len(frame)} rows" if is_experiment else f"{n} poses"
    finish(summary, [f"{output}: {count}", *lines], notes, as_json=as_json)


def _calibrate(
    machine: Machine, n: int, method: str, given: Array | None, seed: int, say: Callable[[str], None]
) -> Planned:
    """Plan the poses that calibrate best."""
    from truepose.identification.leaves.planning.plan import plan as run
    from truepose.identification.leaves.planning.showing import plan_json, plan_lines, plan_notes, plan_table

    chosen = method or ("continuous" if given is None else "exchange")
    found = run(machine, n, method=chosen, seed=seed, candidates=given, progress=say)
    frame = plan_table(found)
    heading = f"poses of {machine.name} for calibration: {n}, {chosen}"
    return frame, heading, plan_lines(found), plan_json(found, list(frame.columns)), plan_notes(found)


def _tell_apart(
    machine: Machine, n: int, names: Sequence[str], diagnosis: Path | None,
    offered: tuple[str, Sequence[str], Sequence[Path]], given: Array | None, seed: int, say: Callable[[str], None],
) -> Planned:  # fmt: skip
    """Plan the experiment that tells explanations apart; ``offered``: payloads, drivers' levels, rows that exist."""
    from truepose.identification.leaves.planning.discriminate.experiment import discriminate
    from truepose.identification.leaves.planning.discriminate.factors import (
        Class,
        class_of,
        explanation,
        read_offer,
    )
    from truepose.identification.leaves.planning.showing import experiment_json, experiment_table, sentences
    from truepose.identification.recording.load import load_recording
    from truepose.identification.report.notes import worded

    payload, varied, exist = offered
    if diagnosis is not None:
        wanted = class_of(findings_of(diagnosis), machine, names, str(diagnosis))
        notes = list(mixture_notes(diagnosis))
    else:
        wanted, notes = Class(tuple(explanation(text, machine) for text in names)), []
    recorded = load_recording(machine, exist, need_observations=False) if exist else None
    offer = read_offer(machine, payload, varied)
    found = discriminate(
        machine, n, wanted, offer=offer, recorded=recorded, candidates=given, seed=seed, progress=say
    )
    frame = experiment_table(found)
    table = {"machine": machine.name, "seed": seed, "rows": len(frame), "columns": list(frame.columns)}
    heading = f"rows of {machine.name} to tell {joined(e.name for e in found.explanations)} apart: {n}"
    told = {**table, **experiment_json(found)}
    return frame, heading, sentences(found), told, [*notes, *worded(found.notes)]


def findings_of(path: Path) -> list[dict[str, Any]]:
    """Read the findings of a ``diagnosis.json``. Raises InputError for a file that diagnose did not write."""
    try:
        return list(json.loads(path.read_text(encoding="utf-8"))["findings"])
    except OSError as exc:
        raise InputError(f"{path}: cannot read the file: {exc.strerror or exc}") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(
            f"{path}: found no `findings`, expected a diagnosis.json that diagnose wrote"
        ) from None


COMMANDS = (plan,)
