"""Tables 5 to 7 and figures 15 to 17 of the report as Markdown, and the numbers behind its sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .fits import PLATFORMS, Outcome
from .relations import Sight

NUMBERS = {"spherical": 1, "linear": 2, "beam": 3, "stiffness": 4}
_ROWS = (("a.x", "Δa_x"), ("a.y", "Δa_y"), ("b.x", "Δb_x"), ("b.y", "Δb_y"), ("length", "Δl"))


def summary(outcomes: Sequence[Outcome], calibration: NDArray[np.bool_]) -> str:
    """One row a calibration: what was chosen, the fit, the points' distance from the drawing, errors."""
    lines = _head(
        "model",
        "platform",
        "parameters",
        "chi2/dof",
        "a, b off the drawing, mm: rms (max)",
        "position, um: mean (max)",
        "on the six",
        "orientation, urad: mean (max)",
        "on the six",
    )
    for o in outcomes:
        cells = [o.model, o.platform, str(len(o.deviation)), f"{o.estimate.fit.chi2_per_dof:.2f}"]
        cells.append(f"{rms(o.points):.2f} ({np.max(np.abs(o.points)):.2f})")
        for errors in (o.position, o.orientation):
            digits = 1 if errors is o.position else 0
            for rows in (calibration, ~calibration):
                cells.append(f"{np.mean(errors[rows]):.{digits}f} ({np.max(errors[rows]):.{digits}f})")
        lines.append(_row(cells))
    return "\n".join(lines)


def chosen_kinds(outcomes: Sequence[Outcome]) -> str:
    """Which kinds of parameters the program chose for each platform, and whether all models agree."""
    lines = []
    for platform in PLATFORMS:
        sets = {_kinds(o.deviation) for o in outcomes if o.platform == platform}
        lines.append(f"- {platform}: " + " / ".join(sorted(sets)))
    return "\n".join(lines)


def deviations(outcome: Outcome) -> str:
    """Distances between nominal and identified values, a column a leg: a table of the report."""
    lines = _head("", *(str(k) for k in range(1, 7)))
    for key, label in _ROWS:
        lines.append(_row([label, *(_cell(outcome.deviation, f"leg{k}.{key}") for k in range(1, 7))]))
    turned = [_direction(outcome.deviation, k) for k in range(1, 7)]
    if any(turned):
        lines.append(_row(["Δu", *turned]))
    kappa = [
        next((v for n, v in outcome.deviation.items() if n.endswith(f"K[{k},{k}]")), None)
        for k in range(1, 7)
    ]
    if any(v is not None for v in kappa):
        lines.append(_row(["10³ Δκ", *("" if v is None else f"{1e3 * v:.2f}" for v in kappa)]))
    return "\n".join(lines)


def sights(rows: Sequence[Sight]) -> str:
    """One row a parameter that was not chosen."""
    lines = _head(
        "a step of",
        "of",
        "shows, sigmas",
        "like",
        "left beside that, sigmas",
        "left beside all chosen, sigmas",
    )
    for s in rows:
        numbers = [f"{value:.3g}" for value in (s.alone, s.apart, s.left)]
        lines.append(_row([s.step, s.name.split("form=1:")[-1], numbers[0], s.partner, *numbers[1:]]))
    return "\n".join(lines)


def over_telescopes(values: Mapping[tuple[str, str], Sequence[tuple[float, float, float]]]) -> str:
    """Mean and range over telescopes of (rms of a and b, mean position error, mean against the truth)."""
    lines = _head(
        "model", "platform", "a, b off the drawing, mm rms", "position error, um", "against the truth, um"
    )
    for (model, platform), numbers in values.items():
        spread = np.array(numbers)
        cells = [
            f"{m:.2f} ({low:.2f} to {high:.2f})"
            for m, low, high in zip(spread.mean(axis=0), spread.min(axis=0), spread.max(axis=0), strict=True)
        ]
        lines.append(_row([model, platform, *cells]))
    return "\n".join(lines)


def rms(values: NDArray[np.float64]) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def _kinds(deviation: Mapping[str, float]) -> str:
    kinds: dict[str, int] = {}
    for name in deviation:
        kind = "kappa" if "K[" in name else "u" if ".u." in name else name.split(".", 1)[1]
        kinds[kind] = kinds.get(kind, 0) + 1
    return ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))


def _cell(deviation: Mapping[str, float], name: str) -> str:
    return f"{deviation[name]:.2f}" if name in deviation else ""


def _direction(deviation: Mapping[str, float], leg: int) -> str:
    return " ".join(f"{axis} {deviation[n]:.3f}" for axis in "xy" if (n := f"leg{leg}.u.{axis}") in deviation)


def _head(*cells: str) -> list[str]:
    return [_row(cells), "|" + "---|" * len(cells)]


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
