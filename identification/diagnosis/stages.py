"""Long recordings: the search begins with some of the rows, and goes on with ten times as many until it has all.

What an effect of note does shows in some thousand rows; what the others add is precision. So most expansion points are found
where a pass over the rows is short, and few passes are over all. Every set that the first rows speak for is weighed again
with more of them, and candidates are the same throughout: those of the whole recording.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from truepose.arrays import Mask
from truepose.errors import ConvergenceError
from truepose.identification.diagnosis.null_fits import Fits, outlying_rows, refitted
from truepose.identification.diagnosis.search import (
    ROUGH,
    Expansion,
    Start,
    prepared,
    search,
    settled,
    start_from,
)
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prior import STATED
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue
from truepose.identification.signatures.signatures import Signatures
from truepose.models.machine.machine import Machine

MANY, SPARED, STEP = 20_000, 2.0, 10.0
"""Calibration rows that a search begins with where there are more than so many times as many, and how many times more follow
at most. Cost alone."""
SEED = 23
FITTING, WEIGHING = "fitting", "weighing"
"""How it is told what goes on with more rows."""


def stages(machine: Machine, recording: Recording) -> list[Recording]:
    """The rows that a search has, one stage after another; the last has all.

    One row is drawn of each few that follow each other, so that no motion is in step with them. Where a reading compares rows
    a part of them says something else, and there is one stage.
    """
    out, rows = [recording], recording.in_time(~recording.validation)
    if any(sensor.compares or sensor.differs_from_row for sensor in machine.sensors):
        return out
    rng = np.random.default_rng(SEED)
    for count in fewer_rows(len(rows)):
        edges = np.linspace(0, len(rows), count + 1).astype(np.int64)
        rows = rows[edges[:-1] + rng.integers(0, np.diff(edges))]
        out.insert(0, recording.subset(np.sort(rows)))
    return out


def fewer_rows(rows: int) -> list[int]:
    """How many rows the stages before all of them have, the largest first: from ``MANY`` on always the same times more."""
    times = rows / MANY
    if times <= SPARED:
        return []
    further = int(np.ceil(np.log(times) / np.log(STEP)))
    return [round(MANY * times ** (k / further)) for k in reversed(range(further))]


def sizes(machine: Machine, recording: Recording) -> list[int]:
    """How many rows each stage after the first has."""
    return [len(rows) for rows in stages(machine, recording)[1:]]


def first(
    machine: Machine,
    recording: Recording,
    fits: Fits,
    cat: Catalogue,
    stop: Callable[[], bool] = lambda: False,
) -> tuple[Fits, Expansion]:
    """The fits without effects, and where the mode stays, by a search of these rows from nothing; once more where other rows
    are far off beside what it finds. ``stop``: whether somebody asked for an end."""
    signatures = Signatures(machine, recording, cat.candidates)
    near = search(signatures, cat, fits.before, fits.outliers, fits.rms, stop)
    again = _far(near.fit, recording)
    if np.array_equal(again, fits.outliers) or stop():
        return fits, near
    fits = refitted(machine, recording, fits, again)
    # a short one is quick from nothing; a long one stays where it is: chains climb from there, too
    start = None if near.short else near.without(again, fits.before, fits.rms)
    del near
    if start is not None:
        return fits, Expansion(start)
    return fits, search(signatures, cat, fits.before, again, fits.rms, stop)


def further(
    near: Expansion, fits: Fits, recording: Recording, progress: Callable[[str], None]
) -> tuple[Fits, Expansion]:
    """The fits without effects, and where the mode stays, with more rows; from where it stayed with fewer.

    Where its set has no minimum with all of them, the search begins from what the file states. It goes on once more where
    other rows are far off beside what it finds.
    """
    machine = near.signatures.machine
    progress(f"{FITTING} {len(recording):,} rows")
    far, fit = _fitted(near, recording)
    fits = refitted(machine, recording, fits, far)
    cat, begins = near.catalogue, fits.before if fit is None else fit
    signatures, cat = prepared(Signatures(machine, recording, cat.candidates), begins, cat)
    progress(f"{WEIGHING} {len(recording):,} rows with {len(cat.candidates)} explanations")
    accepted, known = near.start.accepted, near.start.known
    if fit is None:
        accepted, known = dict.fromkeys(cat.stated, STATED), None
    bare = Signatures(machine, recording, ()).linearise(fits.before).bare()
    own, halved = (
        (far, fits.rms, near.start.refined, None, bare, known),
        len(recording) == len(recording.whole),
    )
    begun = Start(signatures, cat, begins, accepted, *own, halved, near.start.stop)
    del near
    near = settled(begun)
    again = _far(near.fit, recording)
    if np.array_equal(again, far) or near.start.stop():
        return fits, near
    others = refitted(machine, recording, fits, again)
    start = near.without(again, others.before, others.rms)
    if start is None:
        return fits, near
    del near
    return others, settled(start)


def _fitted(near: Expansion, recording: Recording) -> tuple[Mask, Estimate | None]:
    """Rows (n,) that are far off beside what was found with fewer, and the fit with it to the others; None if it has none."""
    machine, terms = near.signatures.machine, near.terms(near.start.accepted)
    begin = start_from(near.fit, terms)
    fitted = partial(estimate, machine, recording, terms, start=begin, noise=near.fit.noise)
    far = _far(fitted(tolerance=np.inf), recording)
    try:
        return far, fitted(exclude=far, tolerance=ROUGH)
    except ConvergenceError:
        return far, None


def _far(fit: Estimate, recording: Recording) -> Mask:
    """Rows (n,) that were to be fitted and are far off."""
    return outlying_rows(fit, recording, ~recording.validation)
