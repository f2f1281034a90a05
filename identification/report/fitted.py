"""The machine of a result, its residuals as a table, and a figure of them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch
from typing import Any

import numpy as np
import pandas as pd

from truepose.errors import InputError
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimated import (
    Estimate,
    Fitted,
    machine_of,
    predicted_frame,
    residual_figure,
    residual_frame,
)
from truepose.identification.fit.tool_pose import calibrated_pose
from truepose.identification.fit.write_machine import calibrated_text
from truepose.identification.prediction.predict import predict
from truepose.identification.recording.load import as_recording
from truepose.identification.report.applied_words import expected_pose
from truepose.identification.report.judgement_words import diagnosis_judgement
from truepose.models.machine.machine import Machine
from truepose.models.units import convert


@predicted_frame.register
def _(result: Fitted, rows: Any) -> pd.DataFrame:
    """Return what the machine of a result predicts for rows."""
    return predict(result.machine, as_recording(result.machine, rows, need_observations=False))


@singledispatch
def file_of(result: Fitted) -> dict[str, Any]:
    """Return what ``write_calibrated`` takes to write the machine of a result, by name."""
    raise TypeError(f"found a {type(result).__name__}, expected an estimate, a calibration or a diagnosis")


@file_of.register
def _(result: Estimate) -> dict[str, Any]:
    return {"estimate": result, "recording": result.recording}


@file_of.register
def _(result: Calibration) -> dict[str, Any]:
    pose = calibrated_pose(result.fit, result.recording, result.began)
    return {"estimate": result.fit, "recording": result.recording, "pose": pose, "kept": result.kept}


@file_of.register
def _(result: Diagnosis) -> dict[str, Any]:
    pose, judgement = expected_pose(result.applied), diagnosis_judgement(result)
    return {"estimate": result.after, "recording": result.recording, "pose": pose, "judgement": judgement}


@machine_of.register
def _(result: Fitted) -> Machine:
    """Return the machine of a result as its file would be read. Raises InputError where the machine has no file."""
    told = file_of(result)
    file = told["estimate"].nominal.file
    return calibrated_text(file.path if file else "", **told)[1]


@residual_frame.register
def _(result: Fitted) -> pd.DataFrame:
    """Return the residuals (n, m) of a result's fit in the machine file's units, and which rows were fitted."""
    fit: Estimate = file_of(result)["estimate"]
    units, index = fit.nominal.units, fit.recording.to_frame().index
    values = fit.residual * [channel.sigma for channel in fit.nominal.channels]
    columns = {
        channel.name: convert(values[:, k], channel.unit, units.written(channel.unit))
        for k, channel in enumerate(fit.nominal.channels)
    }
    return pd.DataFrame({**columns, "fitted": fit.used}, index=index)


@residual_figure.register
def _(result: Fitted) -> Any:
    """Return a figure with a panel for each kind of reading: the size of each row's residual, before and after."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise InputError(
            "plot: found no matplotlib, expected it installed: pip install 'truepose[plot]'"
        ) from None
    fits = _drawn(result)
    machine = next(iter(fits.values())).nominal
    kinds = list(machine.residual_units.items())
    figure = Figure(figsize=(8.0, 2.5 * len(kinds)), layout="constrained")
    for axes, (kind, unit) in zip(figure.subplots(len(kinds), squeeze=False)[:, 0], kinds, strict=True):
        at = [k for k, channel in enumerate(machine.channels) if channel.kind == kind]
        sigma = np.array([machine.channels[k].sigma for k in at])
        written = machine.units.written(unit)
        for name, fit in fits.items():
            size = np.linalg.norm(fit.residual[:, at] * sigma, axis=1)
            axes.plot(np.arange(1, len(size) + 1), convert(size, unit, written), ".", label=name)
        axes.set(xlabel="row", ylabel=f"{kind} residual [{written}]")
        axes.legend()
    return figure


def _drawn(result: Fitted) -> Mapping[str, Estimate]:
    if isinstance(result, Diagnosis):
        return {"before": result.before, "after": result.after}
    return {"fit": file_of(result)["estimate"]}
