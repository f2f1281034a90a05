"""Forms of several sources: what one element does as a function of two recorded things, or of all joints, screened at a fit.

There are thousands of them (elements, pairs, degrees), far too many for the catalogue. Each is weighed by itself against what
the fit leaves, with its geometry and effects free in their priors, and those whose evidence pays their prior become
candidates. The posterior judges; a form that is proposed has the prior that it would have had among all of them.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp

from truepose.arrays import Array, Index
from truepose.identification import prior
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.sensor_rows import Block
from truepose.identification.signatures.candidates import Catalogue, arrivals, varied, ways_of
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effects import empirical as forms
from truepose.models.effects.base import PlacedEffect, Settings
from truepose.models.effects.empirical import LOAD, Empirical, exponents, largest_sizes, products, scaled
from truepose.models.machine.machine import FRAMES
from truepose.models.machine.placed import EffectAtPlace

ROWS = 400
"""Rows that are screened at most, spread evenly: what stands out shows in some. Cost alone."""
MOST, WORSE = 8, 6.0
"""Most forms that are proposed at one fit, and nats by which they may be less likely than the best."""
PAIR, BENT, MOUNT, EVERY = 2, 4, 3, 2
"""Degrees of a pair along a displacement, of a bent one, of a pair at a mount, and of all joints together."""
STIFF = 1e6
"""1-sigma, in units of the noise, of what a parameter without a prior does to the readings."""


@dataclass(frozen=True)
class Rows:
    """What a fit leaves in some rows: ``slopes`` (n, k, p) by ports, their ``ports``; residual (n, m); known (n, m, u): what
    geometry and effects of the fit may still do, N(0, 1) each; ``changes`` turns (n, k, w) into (n, m, w)."""

    ports: Mapping[str, int]
    slopes: Array
    residual: Array
    known: Array
    changes: Callable[[Array], Array]
    by_row: bool
    chosen: Index

    @property
    def known_flat(self) -> Array:
        """(n m, u) of all readings."""
        return self.known.reshape(-1, self.known.shape[2])


@dataclass(frozen=True)
class Element:
    """What an element's motions do to the readings of each row: slopes (n, k, p), their squares (n, p p) and products with
    what geometry and effects do (n, p u), and with what is left (n, p)."""

    slopes: Array
    squares: Array
    across: Array
    score: Array

    @classmethod
    def of(cls, slopes: Array, rows: Rows, left: Array) -> Element:
        """Of slopes (n, k, p); the products only where every reading stands for itself."""
        if not rows.by_row:
            return cls(slopes, np.zeros(0), np.zeros(0), np.zeros(0))
        n, turned = len(slopes), slopes.transpose(0, 2, 1)
        squares, across = (turned @ slopes).reshape(n, -1), (turned @ rows.known).reshape(n, -1)
        return cls(slopes, squares, across, (turned @ left[:, :, None])[:, :, 0])


@dataclass(frozen=True)
class Form:
    """An element's form: settings, and its columns as products of polynomials of sources."""

    place: str
    sources: tuple[str, ...]
    degree: int
    spatial: bool

    def placed(self, signatures: Signatures, seen: Mapping[str, tuple[float, float]]) -> PlacedEffect:
        """The same as a candidate."""
        settings = forms.seen_over(
            {name: seen[name] for name in self.sources}, self.degree, spatial=self.spatial
        )
        return PlacedEffect.at(Empirical(), signatures.machine, (self.place,), settings)


def proposed_products(signatures: Signatures, fit: Estimate, cat: Catalogue) -> Catalogue:
    """The catalogue with forms of several sources that a fit leaves; the very same one where there are none."""
    screen = Screen(signatures, fit)
    found = list[tuple[float, float, Form]]()
    for place, every in screen.forms():
        price = _price(cat, place, len(every))
        if price is None:
            continue
        best: dict[tuple[str, ...], tuple[float, float, Form]] = {}
        for form in every:
            own = (screen.gain(form) + price, price, form)
            if form.sources not in best or own[0] > best[form.sources][0]:
                best[form.sources] = own
        found += best.values()
    found.sort(key=lambda each: -each[0])
    labels, new = {c.label for c in cat.candidates}, list[tuple[PlacedEffect, float]]()
    for value, price, form in found:
        if value < max(found[0][0] - WORSE, -prior_of_slot()) or len(new) == MOST:
            break
        placed = form.placed(signatures, screen.seen_at(form.place))
        if placed.label not in labels:
            new.append((placed, price))
    if not new:
        return cat
    log_prior = (*cat.log_prior, *(price for _, price in new))
    return replace(cat, candidates=(*cat.candidates, *(placed for placed, _ in new)), log_prior=log_prior)


def prior_of_slot() -> float:
    return 0.0


def _price(cat: Catalogue, place: str, count: int) -> float | None:
    """Log prior of one of ``count`` forms at a place: all of them weigh as much as all of one source."""
    own = [k for k, c in enumerate(cat.candidates) if c.at_place == EffectAtPlace(Empirical.slug, (place,))]
    single = [
        k for k in own if sum(key.startswith(forms.FROM) for key in cat.candidates[k].settings_map) == 1
    ]
    if not single:
        return None
    return float(logsumexp([cat.log_prior[k] for k in single]) - np.log(count))


class Screen:
    """A fit's rows, and the evidence of forms in them."""

    def __init__(self, signatures: Signatures, fit: Estimate) -> None:
        self._signatures, self._fit = signatures, fit
        self._machine, self._recording = signatures.machine, signatures.recording
        self._seen = varied(self._machine, self._recording)
        self._rows = rows = self._some_rows()
        flat, residual = rows.known_flat, rows.residual.reshape(-1)
        self._factor = cho_factor(flat.T @ flat + np.eye(flat.shape[1]))
        self._left = (residual - flat @ cho_solve(self._factor, flat.T @ residual)).reshape(
            rows.residual.shape
        )
        self._energy, self._count = float(residual @ self._left.reshape(-1)), residual.size
        rms = np.sqrt(max(self._energy / self._count, 1.0))
        self._noises = np.geomspace(1.0, rms, 5) if rms > 1.0 else np.ones(1)
        self._values = self._sources()
        self._elements, self._polynomials = (
            dict[tuple[str, bool], Element](),
            dict[tuple[str, tuple[str, ...], int], Array](),
        )

    def seen_at(self, place: str) -> dict[str, tuple[float, float]]:
        """Ranges of all that a place's forms may be functions of."""
        own = self._seen | ({} if place in FRAMES else arrivals(self._recording, place))
        return own | ({LOAD: self._loads[place]} if place in self._loads else {})

    def forms(self) -> Iterator[tuple[str, list[Form]]]:
        """All forms of several sources of each joint and mount: pairs with a joint or a load among them, and all joints."""
        joints = [name for name in self._machine.mechanism.readings if name in self._seen]
        for place in (*self._machine.mechanism.readings, *FRAMES):
            spatial = True in ways_of(self._machine, place) if place not in FRAMES else False
            ways = [(MOUNT, False)] if place in FRAMES else [(PAIR, False), (BENT, False), (BENT, True)]
            ways = [(degree, way) for degree, way in ways if spatial or not way]
            moving = {*joints, LOAD}
            pairs = [pair for pair in itertools.combinations(self.seen_at(place), 2) if moving & {*pair}]
            out = [Form(place, pair, degree, way) for pair in pairs for degree, way in ways]
            if len(joints) > 2:
                out += [Form(place, tuple(joints), degree, spatial) for degree in range(1, EVERY + 1)]
            yield place, out

    def gain(self, form: Form) -> float:
        """Log Bayes factor of a form alone beside what the fit holds."""
        return self._evidence(*self._normal(form))

    def _element(self, place: str, spatial: bool) -> Element:
        if (place, spatial) not in self._elements:
            settings: Settings = forms.seen_over({}, 1, spatial=spatial)
            ports = Empirical().moved_ports(self._machine, (place,), settings).values()
            largest = largest_sizes(self._machine)
            unit = np.array([largest[self._machine.ports[port].unit] for port in ports])
            slopes = self._rows.slopes[:, :, [self._rows.ports[port] for port in ports]] * unit
            self._elements[place, spatial] = Element.of(slopes, self._rows, self._left)
        return self._elements[place, spatial]

    def _functions(self, form: Form) -> Array:
        """(n, f) products of polynomials of a form's sources, each less likely the higher its degree."""
        key = (form.place if LOAD in form.sources else "", form.sources, form.degree)
        if key not in self._polynomials:
            columns = [self._values[form.place if name == LOAD else "", name] for name in form.sources]
            wanted = exponents(len(columns), form.degree)
            each = zip(products(columns, wanted), wanted, strict=True)
            self._polynomials[key] = np.column_stack([f / sum(e) ** forms.DECAY for f, e in each])
        return self._polynomials[key]

    def _normal(self, form: Form) -> tuple[Array, Array]:
        """Gram matrix and scores of a form's columns, geometry and effects projected out."""
        rows, functions, element = self._rows, self._functions(form), self._element(form.place, form.spatial)
        (n, f), p = functions.shape, element.slopes.shape[2]
        if rows.by_row:
            squares = (functions[:, :, None] * functions[:, None, :]).reshape(n, f * f)
            gram = (
                (element.squares.T @ squares).reshape(p, p, f, f).transpose(0, 2, 1, 3).reshape(p * f, p * f)
            )
            across = (functions.T @ element.across).reshape(f, p, -1).transpose(1, 0, 2).reshape(p * f, -1)
            score = (functions.T @ element.score).T.reshape(-1)
        else:
            wide = element.slopes[:, :, :, None] * functions[:, None, None, :]
            wide = rows.changes(wide.reshape(*wide.shape[:2], -1))
            flat = wide.reshape(-1, wide.shape[2])
            gram, across, score = flat.T @ flat, flat.T @ rows.known_flat, flat.T @ self._left.reshape(-1)
        return gram - across @ cho_solve(self._factor, across.T), score

    def _evidence(self, gram: Array, score: Array) -> float:
        """Log Bayes factor of N(0, q^2) coefficients, over sizes q and a noise between the stated one and what is left."""
        values, vectors = np.linalg.eigh(gram)
        values, along = np.maximum(values, 0.0), (vectors.T @ score) ** 2
        noise = self._noises[:, None, None]
        size = (prior.SIZES.values[:, None] / noise) ** 2
        share = 1.0 + size * values
        each = 0.5 * np.sum(size * along / noise**2 / share - np.log(share), axis=2) + prior.SIZES.log_prior
        plain = -0.5 * self._energy / self._noises**2 - self._count * np.log(self._noises)
        return float(np.max(plain + np.logaddexp.reduce(each, axis=1)) - np.max(plain))

    def _some_rows(self) -> Rows:
        signatures, fit = self._signatures, self._fit
        used = np.flatnonzero(fit.used)
        predictor = signatures.predictor(fit.effects)
        names = predictor.model.names
        effect = Empirical()
        places = [*self._machine.mechanism.readings, *FRAMES]
        wanted = dict.fromkeys(
            port
            for place in places
            for way in ((False,) if place in FRAMES else ways_of(self._machine, place))
            for port in effect.moved_ports(
                self._machine, (place,), forms.seen_over({}, 1, spatial=way)
            ).values()
        )
        at = [names.index(port) for port in wanted]
        by_row = signatures.by_row
        if by_row and len(used) > ROWS:
            used = used[np.unique(np.linspace(0, len(used) - 1, ROWS).astype(np.intp))]
        chosen = used if by_row else np.arange(len(fit.used))
        p = np.concatenate([fit.p, np.zeros(len(names) - len(fit.p))])
        some = predictor.of_rows(chosen) if by_row else predictor
        slopes, residual, known, blocks = list[Array](), list[Array](), list[Array](), list[Block]()
        free, sigma = fit.prior.free, fit.prior.sigma[fit.prior.free]
        counts = fit.used[chosen] * fit.weights[chosen]
        for block in some.blocks(p, fit.x[chosen], counts):
            root = np.sqrt(counts[block.rows])[:, None, None]
            here = block.here[:, :, at]
            slopes.append(here * root if by_row else here)
            known.append(block.jacobian[:, :, free] * root)
            residual.append(block.residual * root[..., 0])
            blocks.append(block)
        every = np.concatenate(known)
        length = np.sqrt(np.sum(every**2, axis=(0, 1)))
        own = np.where(np.isfinite(sigma), sigma, STIFF)
        own = np.minimum(own, STIFF / np.maximum(length, 1e-300))
        root = np.sqrt(counts)[:, None, None]

        def changes(change: Array) -> Array:
            return np.concatenate([b.changes(change[b.rows]) for b in blocks]) * root

        ports = {port: k for k, port in enumerate(wanted)}
        return Rows(
            ports,
            np.concatenate(slopes),
            np.nan_to_num(np.concatenate(residual)),
            every * own,
            changes,
            by_row,
            chosen,
        )

    def _sources(self) -> dict[tuple[str, str], Array]:
        """Values (n,) of every source from -1 to 1, by place (none but for loads) and name."""
        machine, rows, out = self._machine, self._rows.chosen, dict[tuple[str, str], Array]()
        columns = self._recording.columns()
        self._loads = dict[str, tuple[float, float]]()
        every = dict(self._seen)
        for joint in machine.mechanism.readings:
            every |= arrivals(self._recording, joint)
        for name, ends in every.items():
            values = columns.get(name)
            values = self._recording.driver(name) if values is None else values
            assert values is not None
            out["", name] = np.clip(scaled(values[rows], *ends), -1.0, 1.0)
        if machine.loaded:
            predictor = self._signatures.predictor(self._fit.effects).of_rows(rows)
            p = np.concatenate([self._fit.p, np.zeros(len(predictor.model.names) - len(self._fit.p))])
            loads = predictor.loads(p, self._fit.x[rows])
            for joint in machine.mechanism.readings:
                values = loads[machine.mechanism.actuator(joint).displacement]
                if np.ptp(values) > 1e-6 * max(float(np.max(np.abs(values))), 1e-6):
                    self._loads[joint] = float(values.min()), float(values.max())
                    out[joint, LOAD] = scaled(values, *self._loads[joint])
        return out
