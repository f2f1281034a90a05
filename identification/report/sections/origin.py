"""Where a report comes from: the program, the files with their digests, the recording's date, instrument, and command."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.recording.recording import Recording
from truepose.identification.report.document import Section, Table
from truepose.identification.report.numbers import measure
from truepose.identification.report.opening import file_name, recording_names
from truepose.identification.report.sections.glossary import words_of_diagnoses, words_of_fits
from truepose.models.machine.machine import Machine
from truepose.version import VERSION

NOT_A_FILE = "not a file"


def diagnosis_origin(diagnosis: Diagnosis) -> Section:
    """Of a diagnosis."""
    section = origin_section(diagnosis.nominal, diagnosis.recording, "diagnose")
    return replace(section, blocks=[*section.blocks, words_of_diagnoses()])


def calibration_origin(calibration: Calibration) -> Section:
    """Of a calibration, with the options that are not the usual ones."""
    usual = {"estimator": "map", "solver": "gn"}
    options = [
        f"--{k} {calibration.method[k]}" for k, v in usual.items() if calibration.method.get(k, v) != v
    ]
    section = origin_section(calibration.fit.nominal, calibration.recording, "calibrate", options)
    return replace(section, blocks=[*section.blocks, words_of_fits()])


def origin_section(
    machine: Machine, recording: Recording, command: str, options: Sequence[str] = ()
) -> Section:
    """Version, files, date, instrument, command."""
    own = file_name(machine) if machine.file is not None else machine.name
    digest = machine.file.digest if machine.file is not None else ""
    line = " ".join(["truepose", command, file_name(machine), recording_names(recording.files), *options])
    digests = recording.digests or ("",) * len(recording.files)
    dates = [when for when in recording.dates if when]
    rows = [
        ["truepose", VERSION],
        ["command, or what does the same", line],
        ["machine file", f"{own}, SHA-256 {digest or NOT_A_FILE}"],
        *(
            ["recording", f"{Path(name).name}, SHA-256 {digest or NOT_A_FILE}"]
            for name, digest in zip(recording.files, digests, strict=True)
        ),
        ["recorded on", ", ".join(dict.fromkeys(dates)) or "not stated in the recording"],
        ["instrument", "; ".join(_instruments(machine)) or "none"],
    ]
    caption = "The same files and the same version give the same report, byte for byte."
    return Section("origin", "Where this report comes from", [Table(["", ""], rows, caption, text_columns=2)])


def _instruments(machine: Machine) -> list[str]:
    """Sensors of the machine file with their stated 1-sigma."""
    out = []
    for sensor in machine.sensors:
        sigmas = dict.fromkeys(f"{c.kind} {measure(c.sigma, c.unit)}" for c in sensor.channels)
        out.append(f"{sensor.type} ({len(sensor.columns)} columns), stated 1 sigma: {', '.join(sigmas)} each")
    return out


__all__ = ["calibration_origin", "diagnosis_origin", "origin_section"]
