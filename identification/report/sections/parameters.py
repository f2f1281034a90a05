"""Section 5: parameters against their tolerances."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimate import Estimate
from truepose.identification.report.document import Block, Plot, Section, Text
from truepose.identification.report.figures import parameters, style
from truepose.models.machine import Machine

Array = NDArray[np.float64]
CANDIDATES = 15


def parameter_section(diagnosis: Diagnosis) -> Section:
    """Parameters in tolerances, three fits."""
    fits = {"free": diagnosis.free, "before": diagnosis.before}
    if diagnosis.terms:
        fits["after"] = diagnosis.after
    key = "after" if diagnosis.terms else "before"
    summary = diagnosis.fits.get(key)
    blocks = parameter_blocks(diagnosis.machine, fits, None if summary is None else summary.worst_allowed)
    return Section("parameters", "Parameters against their tolerances", blocks)


def parameter_blocks(machine: Machine, fits: Mapping[str, Estimate], allowed: float | None) -> list[Block]:
    """Dot plot over every parameter of finite tolerance."""
    rows = [k for k, p in enumerate(machine.parameters) if 0 < p.tolerance < np.inf]
    if not rows:
        return [Text("No parameter has a finite tolerance, so none can be judged against its drawing.")]
    looks = {
        "free": ("free fit", style.FREE, "x-thin"),
        "before": ("tolerances, no effects", style.BEFORE, "diamond-open"),
        "after": ("with effects", style.AFTER, "circle"),
        "calibrated": ("calibrated", style.AFTER, "circle"),
    }
    series = [(*looks[key], fit.in_tolerances[rows]) for key, fit in fits.items()]
    names = [machine.parameters[k].name for k in rows]
    clip = [k for k, key in enumerate(fits) if key == "free" and len(fits) > 1]
    home = " Driven out without effects and home with them is the mark of concealed physics."
    more = f" The {parameters.MOST} farthest of {len(rows)} are shown." if len(rows) > parameters.MOST else ""
    caption = (
        "Where each fit puts each parameter, in drawing tolerances. Shaded: one tolerance either side."
        " Dashed: what the farthest parameter of a true model stays within in 99 of 100 cases."
        f"{home if 'after' in fits else ''} Grey triangles: the free fit is off the scale.{more}"
    )
    return [Plot(parameters.dot_plot(names, series, allowed, clip), caption)]
