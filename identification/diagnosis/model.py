"""The model that a diagnosis ends with: the likeliest set, what has no name included, fitted without linearisation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError
from truepose.identification.diagnosis.search import Found, start_from
from truepose.identification.fit.estimate import Estimate, estimate
from truepose.identification.fit.problem import Prior, prior_of
from truepose.identification.fit.tolerance_classes import part_classes
from truepose.identification.posterior.moments import moments
from truepose.models.effects.base import PlacedEffect

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
WORTH = 0.95
"""Share of the remainder's signal that the forms which are carried hold; the others are left to the noise."""
FEW = 40
"""Most forms of the remainder that are carried."""


@dataclass(frozen=True)
class Shape:
    """A form of the remainder: index of its candidate, prior 1-sigma of each coefficient in its scale, share of the signal."""

    candidate: int
    sigma: Array
    share: float


def remainder_shapes(found: Found) -> tuple[Shape, ...]:
    """The forms that make most of the remainder of the mode, the largest first; none where it has none."""
    problem, mode = found.problem, found.mode
    tau = problem.spike_slab.unknowns.size.values[mode.point.remainder]
    if tau == 0.0 or not problem.remainder.size:
        return ()
    known, always = moments(problem.spike_slab, mode), problem.spike_slab.design.always
    coefficients = problem.remainder @ known.mean[: len(always.sigma)][always.remainder]
    sigma = tau * np.sqrt(np.sum(problem.remainder**2, axis=1))
    lin, cat, at, shapes = found.linearisation, found.catalogue, 0, list[Shape]()
    for i in cat.smooth:
        width = len(cat.candidates[i].coefficients)
        part = slice(at, at + width)
        columns = lin.free + problem.nameless[part]
        signal = float(coefficients[part] @ lin.gram[np.ix_(columns, columns)] @ coefficients[part])
        shapes.append(Shape(i, sigma[part], signal))
        at += width
    return _largest(shapes)


def _largest(shapes: list[Shape]) -> tuple[Shape, ...]:
    total = sum(s.share for s in shapes)
    out: list[Shape] = []
    for shape in sorted(shapes, key=lambda s: -s.share)[:FEW]:
        if total <= 0.0 or sum(s.share for s in out) > WORTH:
            break
        out.append(replace(shape, share=shape.share / total))
    return tuple(out)


def fitted(
    found: Found, accepted: Mapping[int, float], shapes: tuple[Shape, ...], exclude: Mask
) -> Estimate | None:
    """The nonlinear fit with candidates (index to spread) and forms of the remainder, tolerances as wide as the mode's.

    Where no minimum is found with both, the candidates alone are tried; None where they have none either.
    """
    for forms in (shapes, ()) if shapes else ((),):
        try:
            return _fitted(found, accepted, forms, exclude)
        except ConvergenceError:
            continue
    return None


def _fitted(
    found: Found, accepted: Mapping[int, float], shapes: tuple[Shape, ...], exclude: Mask
) -> Estimate:
    machine, recording, cat = found.signatures.machine, found.signatures.recording, found.catalogue
    terms = [replace(cat.candidates[i], spread=spread) for i, spread in accepted.items()]
    extra = [s for s in shapes if s.candidate not in accepted]
    terms += [cat.candidates[s.candidate] for s in extra]
    prior = _prior(found, terms, len(accepted), extra)
    start = start_from(found.fit, terms)
    return estimate(machine, recording, terms, start=start, exclude=exclude, prior=prior)


def _prior(found: Found, terms: list[PlacedEffect], first: int, extra: list[Shape]) -> Prior:
    """Tolerances widened as the mode has them, and each coefficient of the remainder with its own 1-sigma."""
    machine, problem = found.signatures.machine, found.problem
    prior = prior_of(machine, terms)
    sigma, count = prior.sigma.copy(), len(machine.parameters)
    factors = dict(
        zip(problem.classes, problem.spike_slab.unknowns.widening[found.mode.point.widening], strict=True)
    )
    free = [k for k in range(count) if sigma[k] > 0.0]
    classes = part_classes([prior.names[k] for k in free], [prior.parts[k] for k in free])
    for k, one in zip(free, classes, strict=True):
        sigma[k] *= factors.get(one, 1.0)
    at = count + sum(len(t.coefficients) for t in terms[:first])
    for shape in extra:
        sigma[at : at + len(shape.sigma)] = shape.sigma * prior.scale[at : at + len(shape.sigma)]
        at += len(shape.sigma)
    # steps of amplitudes in their own 1-sigma: sizes apart by orders of magnitude must not pass for rounding
    scale = np.where((np.arange(len(sigma)) >= count) & (sigma > 0.0), sigma, prior.scale)
    return replace(prior, sigma=sigma, scale=scale)
