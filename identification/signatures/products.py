"""Forms of several sources: what one element does as a function of two recorded things, or of all joints, screened at a fit.

There are thousands of them (elements, pairs, degrees), far too many for the catalogue. Each is weighed by itself against what
the fit leaves, with its geometry and effects free in their priors, and those whose evidence pays their prior become
candidates. The posterior judges; a form that is proposed has the prior that it would have had among all of them.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve
from scipy.special import logsumexp

from truepose.arrays import Array
from truepose.identification import prior
from truepose.identification.fit.estimated import Estimate
from truepose.identification.signatures.candidates import Catalogue
from truepose.identification.signatures.screened_rows import ScreenedRows, screened_rows
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.empirical import LOAD, MOMENT, Empirical, largest_sizes
from truepose.models.effects.polynomials import (
    DECAY,
    FROM,
    SPATIAL,
    TO,
    exponents,
    products,
    scaled,
    seen_over,
)
from truepose.models.machine.machine import FRAMES, Machine

MOST, WORSE = 8, 6.0
"""Most forms that are proposed at one fit, and nats by which they may be less likely than the best."""
PAIR, BENT, MOUNT, EVERY = 2, 4, 3, 2
"""Degrees of a pair along a displacement, of a bent one, of a pair at a mount, and of all joints together."""
Ranges = Mapping[str, tuple[float, float]]
"""Sources with the lowest and highest value that was seen."""


@dataclass(frozen=True)
class Element:
    """A joint or mount: the sources that its forms may be functions of, whether a joint errs in six motions, too, and the log
    prior of all its forms of one source together, which those of several share."""

    place: str
    sources: Ranges
    spatial: bool
    log_prior: float


def elements_of(machine: Machine, cat: Catalogue) -> list[Element]:
    """Every joint and mount with what the catalogue's forms of one source say of it."""
    out = []
    for place in (*machine.mechanism.readings, *FRAMES):
        own = [k for k, c in enumerate(cat.candidates) if not cat.has_law(k) and c.place == (place,)]
        names = {k: [n for n in cat.candidates[k].settings_map if n.startswith(FROM)] for k in own}
        single = [k for k in own if len(names[k]) == 1]
        unpaired = (MOMENT, LOAD) if place in FRAMES else ()
        sources: dict[str, tuple[float, float]] = {}
        for settings, key in ((cat.candidates[k].settings_map, key) for k in own for key in names[k]):
            name = key.removeprefix(FROM)
            if name not in unpaired:
                sources[name] = settings[key], settings[f"{TO}{name}"]
        if single:
            spatial = any(SPATIAL in cat.candidates[k].settings_map for k in single)
            shared = float(logsumexp([cat.log_prior[k] for k in single]))
            out.append(Element(place, sources, spatial, shared))
    return out


@dataclass(frozen=True)
class Form:
    """A form of several sources at a place: the total degree, and whether a joint errs in all six motions."""

    place: str
    sources: tuple[str, ...]
    degree: int
    spatial: bool = False

    def settings(self, ranges: Ranges) -> dict[str, float]:
        """What it is called as an effect."""
        return seen_over({name: ranges[name] for name in self.sources}, self.degree, spatial=self.spatial)


def forms_of(element: Element, joints: Sequence[str]) -> Iterator[Form]:
    """All forms of several sources: pairs with a joint or a load among them, and all joints together."""
    place = element.place
    ways = [(PAIR, False), (BENT, False), (BENT, True)] if place not in FRAMES else [(MOUNT, False)]
    moved = [name for name in joints if name in element.sources]
    for pair in itertools.combinations(element.sources, 2):
        if {*moved, LOAD} & {*pair}:
            yield from (Form(place, pair, degree, way) for degree, way in ways if element.spatial or not way)
    if len(moved) > 2:
        for degree in range(1, EVERY + 1):
            yield Form(place, tuple(moved), degree, element.spatial)


def proposed_products(signatures: Signatures, fit: Estimate, cat: Catalogue) -> Catalogue:
    """Return the catalogue with forms of several sources that a fit leaves; the very same one where there are none."""
    machine = signatures.machine
    elements = {element.place: element for element in elements_of(machine, cat)}
    screen = Screen(signatures, fit, list(elements.values()))
    found = list[tuple[float, float, Form]]()
    for element in elements.values():
        every = list(forms_of(element, machine.mechanism.readings))
        price = element.log_prior - float(np.log(max(len(every), 1)))
        best: dict[tuple[str, ...], tuple[float, float, Form]] = {}
        for form in every:  # of one place and the same sources the likeliest
            value = screen.gain(form) + price
            best[form.sources] = max(
                best.get(form.sources, (-np.inf, 0.0, form)), (value, price, form), key=_value
            )
        found += best.values()
    found.sort(key=_value, reverse=True)
    labels, new = {c.label for c in cat.candidates}, list[tuple[PlacedEffect, float]]()
    for value, price, form in found:
        if value < max(found[0][0] - WORSE, 0.0) or len(new) == MOST:
            break
        settings = form.settings(elements[form.place].sources)
        placed = PlacedEffect.at(Empirical(), machine, (form.place,), settings)
        new += [(placed, price)] if placed.label not in labels else []
    if not new:
        return cat
    log_prior = (*cat.log_prior, *(price for _, price in new))
    return replace(cat, candidates=(*cat.candidates, *(placed for placed, _ in new)), log_prior=log_prior)


def _value(found: tuple[float, float, Form]) -> float:
    return found[0]


@dataclass(frozen=True)
class Motions:
    """What an element's motions do to the readings of each row: slopes (n, k, p); where every reading stands for itself their
    squares (n, p p), and products with what geometry and effects do (n, p u) and with what is left (n, p)."""

    slopes: Array
    rows: ScreenedRows

    @cached_property
    def squares(self) -> Array:
        return np.asarray((self.slopes.transpose(0, 2, 1) @ self.slopes).reshape(len(self.slopes), -1))

    @cached_property
    def across(self) -> Array:
        return np.asarray((self.slopes.transpose(0, 2, 1) @ self.rows.known).reshape(len(self.slopes), -1))

    @cached_property
    def score(self) -> Array:
        return np.asarray((self.slopes.transpose(0, 2, 1) @ self.rows.left[:, :, None])[:, :, 0])

    def normal(self, functions: Array) -> tuple[Array, Array, Array]:
        """Gram matrix (w, w), products with U (w, u) and scores (w,) of each motion times each of ``functions`` (n, f)."""
        (n, f), p = functions.shape, self.slopes.shape[2]
        if not self.rows.by_row:
            wide = self.slopes[:, :, :, None] * functions[:, None, None, :]
            wide = self.rows.changes(wide.reshape(*wide.shape[:2], -1))
            flat = wide.reshape(-1, wide.shape[2])
            return flat.T @ flat, flat.T @ self.rows.flat, flat.T @ self.rows.left.reshape(-1)
        squares = (functions[:, :, None] * functions[:, None, :]).reshape(n, f * f)
        gram = (self.squares.T @ squares).reshape(p, p, f, f).transpose(0, 2, 1, 3).reshape(p * f, p * f)
        across = (functions.T @ self.across).reshape(f, p, -1).transpose(1, 0, 2).reshape(p * f, -1)
        return gram, across, (functions.T @ self.score).T.reshape(-1)


class Screen:
    """A fit's rows, and the evidence of forms in them."""

    def __init__(self, signatures: Signatures, fit: Estimate, elements: Sequence[Element]) -> None:
        self._machine, self._recording = signatures.machine, signatures.recording
        self._ranges = {element.place: element.sources for element in elements}
        ways = [(e.place, way) for e in elements for way in ((False, True) if e.spatial else (False,))]
        ports = dict.fromkeys(port for way in ways for port in self._ports(*way))
        self.rows = screened_rows(signatures, fit, list(ports))
        largest = largest_sizes(self._machine)
        self.motions = dict[tuple[str, bool], Motions]()
        for way in ways:
            unit = np.array([largest[self._machine.ports[port].unit] for port in self._ports(*way)])
            slopes = self.rows.slopes[:, :, [self.rows.ports[port] for port in self._ports(*way)]] * unit
            self.motions[way] = Motions(slopes, self.rows)
        self._energy = float(self.rows.residual.reshape(-1) @ self.rows.left.reshape(-1))
        rms = np.sqrt(max(self._energy / self.rows.residual.size, 1.0))
        self._noises = np.geomspace(1.0, rms, 5) if rms > 1.0 else np.ones(1)
        self._polynomials = dict[tuple[str, tuple[str, ...], int], Array]()

    def gain(self, form: Form) -> float:
        """Log Bayes factor of a form alone beside what the fit holds."""
        gram, across, score = self.motions[form.place, form.spatial].normal(self.functions(form))
        return self._evidence(gram - across @ cho_solve(self.rows.factor, across.T), score)

    def functions(self, form: Form) -> Array:
        """(n, f) products of polynomials of a form's sources, each less likely the higher its degree."""
        key = (form.place if LOAD in form.sources else "", form.sources, form.degree)
        if key not in self._polynomials:
            wanted = exponents(len(form.sources), form.degree)
            columns = [self._source(form.place, name) for name in form.sources]
            each = zip(products(columns, wanted), wanted, strict=True)
            self._polynomials[key] = np.column_stack([f / sum(e) ** DECAY for f, e in each])
        return self._polynomials[key]

    def _ports(self, place: str, spatial: bool) -> tuple[str, ...]:
        settings = seen_over({}, 1, spatial=spatial)
        return tuple(Empirical().moved_ports(self._machine, (place,), settings).values())

    def _source(self, place: str, name: str) -> Array:
        """(n,) values of a source at a place, from -1 to 1 over what was seen."""
        if name == LOAD:
            values = self.rows.loads[self._machine.mechanism.actuator(place).displacement]
        else:
            column = self._recording.columns().get(name)
            column = self._recording.driver(name) if column is None else column
            assert column is not None
            values = column[self.rows.index]
        return np.clip(scaled(values, *self._ranges[place][name]), -1.0, 1.0)

    def _evidence(self, gram: Array, score: Array) -> float:
        """Log Bayes factor of N(0, q^2) coefficients, over sizes q and a noise between the stated one and what is left."""
        values, vectors = np.linalg.eigh(gram)
        values, along = np.maximum(values, 0.0), (vectors.T @ score) ** 2
        noise = self._noises[:, None, None]
        size = (prior.SIZES.values[:, None] / noise) ** 2
        share = 1.0 + size * values
        each = 0.5 * np.sum(size * along / noise**2 / share - np.log(share), axis=2) + prior.SIZES.log_prior
        plain = -0.5 * self._energy / self._noises**2 - self.rows.residual.size * np.log(self._noises)
        return float(np.max(plain + np.logaddexp.reduce(each, axis=1)) - np.max(plain))
