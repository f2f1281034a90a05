"""``plan --discriminate``: the experiment that splits explanations, from the command line's texts to its lines."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truepose.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from truepose.identification.leaves.planning.discriminate.experiment import Experiment
    from truepose.models.machine.machine import Machine

DiscriminateOption = Annotated[
    tuple[str, str] | None,
    typer.Option(
        "--discriminate",
        metavar="A B",
        help="Poses that tell two explanations apart, SLUG@PLACE[:name=value[unit],...] each, as simulate names effects.",
    ),
]
RivalOption = Annotated[
    list[str] | None,
    typer.Option("--rival", metavar="C", help="A further explanation; repeatable. The worst pair counts."),
]
DiagnosisOption = Annotated[
    Path | None,
    typer.Option(
        "--diagnosis",
        metavar="FILE",
        help="diagnosis.json: split the class of its finding, at its fitted value.",
    ),
]
PayloadOption = Annotated[
    str, typer.Option("--payload", metavar="0,2.5,5", help="Payloads that can be carried, kg.")
]
TemperatureOption = Annotated[
    list[str] | None,
    typer.Option(
        "--temperature",
        metavar="PLACE=15,20,30",
        help="Temperatures a place can be held at, degC; repeatable (air: every place alike).",
    ),
]
VaryOption = Annotated[
    list[str] | None,
    typer.Option(
        "--vary",
        metavar="DRIVER=...",
        help="Levels of another driver (pressure in hPa, velocity.JOINT in mm/s or rad/s); repeatable.",
    ),
]
WithOption = Annotated[
    list[Path] | None,
    typer.Option("--with", metavar="RECORDING", help="Rows measured already, to be added to; repeatable."),
]
TargetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--target",
        metavar="NAME=x,y,z",
        help="Say what a further target there (tool frame, units of the file) would bring; repeatable.",
    ),
]


@dataclass(frozen=True)
class Request:
    """What the options ask for."""

    names: tuple[str, ...] = ()
    diagnosis: Path | None = None
    payload: str = ""
    vary: tuple[str, ...] = ()
    recorded: tuple[Path, ...] = ()
    targets: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        discriminate: tuple[str, str] | None,
        rival: Sequence[str] | None,
        diagnosis: Path | None,
        payload: str,
        temperature: Sequence[str] | None,
        vary: Sequence[str] | None,
        recorded: Sequence[Path] | None,
        target: Sequence[str] | None,
    ) -> Request:
        """Options of their types, None where they were left out."""
        return cls(
            names=(*(discriminate or ()), *(rival or ())),
            diagnosis=diagnosis,
            payload=payload,
            vary=(*(f"temperature.{text}" for text in temperature or ()), *(vary or ())),
            recorded=tuple(recorded or ()),
            targets=tuple(target or ()),
        )

    @property
    def wanted(self) -> bool:
        """Whether explanations are to be told apart at all. Raises InputError for options that then mean nothing."""
        asked = bool(self.names) or self.diagnosis is not None
        if not asked and (self.payload or self.vary or self.recorded or self.targets):
            raise InputError(
                "--payload, --temperature, --vary, --with and --target: found without --discriminate A B or "
                "--diagnosis FILE, expected explanations to tell apart"
            )
        return asked


def run(
    machine: Machine, n: int, asked: Request, candidates: Path | None, seed: int, say: Callable[[str], None]
) -> tuple[Experiment, pd.DataFrame, list[str], dict[str, object]]:
    """The experiment, its table, its lines and its JSON."""
    from truepose.identification.leaves.planning.discriminate.experiment import discriminate
    from truepose.identification.leaves.planning.discriminate.factors import (
        Class,
        Offer,
        Target,
        class_of,
        explanation,
    )
    from truepose.identification.leaves.planning.discriminate.words import experiment_json, sentences
    from truepose.identification.leaves.planning.pose_tables import experiment_table
    from truepose.identification.recording.load import load_recording

    if asked.diagnosis is not None:
        wanted = class_of(findings_of(asked.diagnosis), machine, asked.names, str(asked.diagnosis))
    else:
        wanted = Class(tuple(explanation(text, machine) for text in asked.names))
    given = None if candidates is None else load_recording(machine, [candidates], need_observations=False).q
    recorded = load_recording(machine, asked.recorded, need_observations=False) if asked.recorded else None
    offer = Offer.of(machine, asked.payload, asked.vary)
    found = discriminate(
        machine,
        n,
        wanted,
        offer=offer,
        recorded=recorded,
        candidates=given,
        targets=[Target.of(text, machine) for text in asked.targets],
        seed=seed,
        progress=say,
    )
    frame = experiment_table(found)
    return found, frame, sentences(found), experiment_json(found)


def findings_of(path: Path) -> list[dict[str, Any]]:
    """The findings of a ``diagnosis.json``. Raises InputError for a file that diagnose did not write."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return list(content["findings"])
    except OSError as exc:
        raise InputError(f"{path}: cannot read the file: {exc.strerror or exc}") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(
            f"{path}: found no `findings`, expected a diagnosis.json that diagnose wrote"
        ) from None
