"""How well the tool is known, as a report tells it: a budget that adds up, tests after the standards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.reports import NAN, fitted, of, recorded
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.identification.fit.tool_pose import READINGS, TOLERANCES, tool_spread
from truepose.identification.identifiability.observability import Note
from truepose.identification.recording.recording import Recording
from truepose.identification.report.closing import geometry_words, uncertainty_section
from truepose.identification.report.notes import tolerance_notes, worded
from truepose.identification.report.results import fit_json
from truepose.models.machine.machine import Machine
from truepose.shown.document import Table, Text

UNITS = {"nm": 1e-6, "µm": 1e-3, "mm": 1.0}


@pytest.fixture(scope="module")
def fit(machine: Machine) -> Estimate:
    """With readings that see every direction."""
    own = fitted(machine, recorded(machine))
    rng = np.random.default_rng(12)
    free = len(own.prior.free)
    return replace(own, factor=np.triu(rng.normal(size=(free + 1, free + 1)) + 9 * np.eye(free + 1)))


@pytest.fixture(scope="module")
def recording(machine: Machine) -> Recording:
    return recorded(machine)


def size(text: str) -> float:
    number, unit = text.split()
    return float(number) * UNITS[unit]


def test_the_budget_adds_up_to_the_mean_variance_at_the_recorded_poses(
    fit: Estimate, recording: Recording
) -> None:
    """Each source by its root mean square; together by theirs, twice of which is told as the expanded uncertainty."""
    table = of(uncertainty_section(fit, recording, None).blocks, Table)[0]
    spread = tool_spread(fit, recording, np.arange(len(recording)))
    parts = {source: float(np.mean(v)) for source, v in spread.variance.items()}
    *sources, combined, expanded = (list(row) for row in table.rows)
    assert [row[1] for row in sources] == ["B" if source == TOLERANCES else "A" for source in parts]
    assert sources[0][0].startswith("noise of the readings") and next(iter(parts)) == READINGS
    whole = sum(parts.values())
    for row, variance in zip(sources, parts.values(), strict=True):
        assert size(row[2]) == pytest.approx(np.sqrt(variance), rel=6e-3)
        assert float(row[3].removesuffix(" %")) == pytest.approx(100 * variance / whole, abs=0.51)
    assert size(combined[2]) == pytest.approx(np.sqrt(whole), rel=6e-3) and combined[3] == "100 %"
    assert expanded[0] == "expanded uncertainty, k = 2" and size(expanded[2]) == pytest.approx(
        2 * np.sqrt(whole), rel=6e-3
    )


def test_nothing_estimated_nothing_told(fit: Estimate, recording: Recording) -> None:
    hollow = replace(fit, residual=np.full_like(fit.residual, NAN))
    (text,) = uncertainty_section(hollow, recording, None).blocks
    assert (
        isinstance(text, Text) and text.text == "Nothing was estimated, so there is no uncertainty to tell."
    )


@pytest.mark.parametrize("before", [True, False])
def test_poses_that_were_visited_three_times_are_tested(
    fit: Estimate, recording: Recording, before: bool
) -> None:
    """Of ten poses the mean and the worst, with the model and, where there is one, before."""
    q = recording.q.copy()
    q[:] = np.repeat(q[:10], 3, axis=0)
    again = replace(recording, q=q, pose=np.repeat(np.arange(10), 3), validation=np.zeros(30, dtype=bool))
    own = replace(fit, used=np.ones(30, dtype=bool))
    worse = replace(own, residual=own.residual + 5.0)
    tables = of(uncertainty_section(own, again, worse if before else None).blocks, Table)
    told = [list(row) for row in tables[-1].rows]
    names = ["pose accuracy AP, before", "pose accuracy AP, with this model", "pose repeatability RP"]
    assert [row[0] for row in told] == names[0 if before else 1 :]
    off = (own.residual * 0.01).reshape(10, 3, 3)
    mean = off.mean(axis=1)
    accuracy = np.linalg.norm(mean, axis=1)
    away = np.linalg.norm(off - mean[:, None], axis=2)
    repeats = away.mean(axis=1) + 3 * away.std(axis=1, ddof=1)
    for row, values in zip(told[-2:], (accuracy, repeats), strict=True):
        assert [size(row[1]), size(row[2])] == pytest.approx([np.mean(values), np.max(values)], rel=6e-3)
    if before:
        shifted = np.linalg.norm(mean + 0.05, axis=1)
        assert [size(told[0][1]), size(told[0][2])] == pytest.approx(
            [np.mean(shifted), np.max(shifted)], rel=6e-3
        )
    assert "of 10 poses with 3 to 3 visits each" in tables[-1].caption


# -- what readings leave open, and notes ---------------------------------------------------------------


def test_constants_that_readings_hardly_tell_and_directions_that_none_sees_are_named(
    machine: Machine, fit: Estimate
) -> None:
    """Those whose 1-sigma is over nine tenths of the tolerance; directions in the words of ``fit.json``."""
    free = [int(k) for k in fit.prior.free if np.isfinite(fit.prior.sigma[k])]
    sharp, dull = (replace(fit, factor=size * fit.factor) for size in (1e6, 1e-6))
    assert geometry_words(sharp)[-1] == "Every parameter is known better than its drawing said."
    assert geometry_words(dull)[-1].startswith(f"For {len(free)} of {len(free)} parameters with a tolerance")
    blind = fitted(machine, recorded(machine))
    rank, *unseen, _ = geometry_words(blind)
    count = len(blind.prior.free)
    assert rank == f"The readings alone determine {count - 1} of {count} directions of the free parameters."
    said = [one["meaning"] for one in fit_json(blind, blind.recording)["unseen"]]
    assert [text[1:].rstrip(".") for text in unseen] == [text[1:] for text in said] and len(said) == 1


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ((1.6, 1.7), ["without effects, all tolerances look 1.7 times too small"]),
        ((1.6, 1.95), ["without effects, length (leg.a) tolerances look 1.6 times too small",
                       "without effects, angle tolerances look 1.9 times too small"]),
        ((1.5, 1.6), ["without effects, angle tolerances look 1.6 times too small"]),
        ((1.5, 1.5), []),
        ((1.6,), ["without effects, length (leg.a) tolerances look 1.6 times too small"]),
        ((), []),
    ],
)  # fmt: skip
def test_tolerances_that_look_too_small_are_told_together_where_all_do_alike(
    values: tuple[float, ...], said: list[str]
) -> None:
    classes = (PartClass("length", "leg.a"), PartClass("angle"))
    assert tolerance_notes(dict(zip(classes, values, strict=False))) == said


def test_notes_are_words_or_become_them() -> None:
    assert worded(["as it is", Note("unassembled", "row 3"), Note("unread", "payload")]) == [
        "as it is",
        "row 3: the mechanism cannot be assembled there; the row was left out",
        "'payload' is offered but no explanation reads it: it is not varied",
    ]
