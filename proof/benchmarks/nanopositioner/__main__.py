"""Tables and figures of docs/machines/nanopositioner.md, or the bundled recordings with --write DIR."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from nanopositioner import charts, drift, study, trajectories
from nanopositioner.plan import Motions, paper_plan
from nanopositioner.recordings import write
from nanopositioner.study import BUNDLE, identify, identify_extrinsic, machine, recorded
from nanopositioner.tables import DAY_0

from truepose.identification.recording.load import load_recording

FIGURES = Path(__file__).resolve().parents[3] / "docs" / "figures"
ERRORS = tuple(round(0.002 * k, 3) for k in range(7))
"""deg added to beta_et: Figure 15."""


def main() -> int:
    """Write the bundle, or print the tables and draw the figures (some minutes)."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.nanopositioner", description=main.__doc__)
    parser.add_argument(
        "--write", type=Path, metavar="DIR", help="write the bundled recordings there and stop"
    )
    parser.add_argument("--only", choices=sorted(PARTS), help="one part of the study")
    chosen = parser.parse_args()
    if chosen.write:
        for path in write(chosen.write):
            _say(str(path))
        return 0
    for name, part in PARTS.items():
        if chosen.only in (None, name):
            part()
    return 0


def validation() -> None:
    """Figures 9 to 12 and 15, from the bundled recording."""
    recording = load_recording(machine(), [BUNDLE / "recording.csv"])
    nominal = np.array([parameter.nominal for parameter in machine().parameters])
    both, alone = identify(recording).p, identify_extrinsic(recording).p
    few = identify_extrinsic(recorded(_level_translations(), 1)).p
    states = (
        ("before calibration", nominal),
        ("extrinsics, 69 motions", alone),
        ("extrinsics, 12 translations", few),
        ("both", both),
    )
    circles = [(name, trajectories.circle(p, DAY_0)) for name, p in states]
    rotation, turned = trajectories.rotary(DAY_0), trajectories.turn(both, DAY_0)
    errors = [(error, trajectories.misaligned(both, DAY_0, error)) for error in ERRORS]
    charts.rotation_chart(_figure("fig09"), rotation)
    charts.circle_chart(_figure("fig10"), "Circle before calibration (Fig. 10)", circles[:1])
    charts.turn_charts(_figure("fig11"), _figure("fig11_joints"), turned)
    charts.circle_chart(_figure("fig12"), "Circle on the mirror's plane (Fig. 12)", circles)
    charts.error_chart(_figure("fig15"), errors[1:])
    _table(
        ("validation motion", "cavity's swing, nm"),
        [
            ["rotation q6 by 90 deg before calibration (Fig. 9)", f"{1e3 * rotation.swing:.0f}"],
            *([f"circle, {name} (Figs. 10, 12)", f"{1e3 * t.swing:.1f}"] for name, t in circles),
            *([f"translation, beta_et {e:+.3f} deg (Fig. 15)", f"{1e3 * t.swing:.1f}"] for e, t in errors),
        ],
    )
    _turns(both)


def _level_translations() -> Motions:
    """The 12 translations of the plan with q6 at 0."""
    plan = paper_plan()
    level = np.flatnonzero((plan.end[:, 5] == 0.0) & (plan.start[:, 3:] == plan.end[:, 3:]).all(axis=1))
    return Motions(plan.start[level], plan.end[level])


def _turns(p: study.Array) -> None:
    rows = []
    for axis, name in enumerate(("X_f", "Y_f", "Z_f")):
        for end in (3.5, -3.5) if axis < 2 else (90.0, -90.0):
            trace = trajectories.turn(p, DAY_0, axis, end)
            held = trace.held
            still = 1e3 * float(np.ptp(trace.change[: held.within]))
            last = trace.along[min(held.within, len(trace.along)) - 1]
            rows.append(
                [name, f"{end:g}", f"{still:.2f}", f"{last:.2f}", ", ".join(held.saturated) or "none"]
            )
    _table(("turned about", "to, deg", "swing while held, nm", "held until, deg", "stopped by"), rows)


def identification() -> None:
    """The study of noise and readings a motion."""
    lines = [study.line(points, sigma, draws) for points, sigma, draws in study.STUDY]
    _table(study.STUDY_HEAD, [study.study_row(line) for line in lines])
    before = study.nominal_score()
    _say(
        f"nominal: dL {before.length:.0f} nm, normal {before.normal:.3f} deg, turned {before.turned:.3f} deg\n"
    )
    charts.study_chart(_figure("identification"), lines)


def durability() -> None:
    """Figures 13 and 14 and the days' table."""
    days = drift.days()
    _table(drift.DAY_HEAD, drift.day_rows(days))
    charts.days_chart(_figure("drift"), days)
    week = days[3]
    curves = [("extrinsics again", week.circles["extrinsic"]), ("all again", week.circles["both"])]
    charts.circle_chart(_figure("fig14"), "Circle after 7 days (Fig. 14)", curves)
    hours = drift.hours(days[0].constants["kept"])
    charts.hours_chart(_figure("fig13"), hours)
    _table(("hours", "circle, nm"), [[f"{hour:g}", f"{1e3 * trace.swing:.0f}"] for hour, trace in hours])


PARTS: dict[str, Callable[[], None]] = {
    "identification": identification,
    "validation": validation,
    "durability": durability,
}


def _figure(name: str) -> Path:
    return FIGURES / f"nanopositioner_{name}.svg"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    for line in (head, ["---"] * len(head), *rows):
        _say("| " + " | ".join(line) + " |")
    _say("")


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
