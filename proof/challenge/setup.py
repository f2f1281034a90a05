"""A specimen in its campaign, as the examiner sees it: exact readings from the simulator, tolerances from the drawing."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from challenge.adaptation import Adaptation
from challenge.imitations import Imitations
from challenge.simulator.base import Campaign, Imperfection, Kind, Plan, SimulatedMachine, Specimen
from challenge.simulator.campaigns import joined
from challenge.simulator.writing import recording_text
from challenge.slopes import Constant, by_constants, constants
from truepose.errors import TrueposeError
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.file.driver import Driver
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
HELD_OUT = Plan(poses=20, repeats=1, extreme=True)


@dataclass(frozen=True)
class Setup:
    """One specimen measured by one plan: rows of ``campaign``, then the held-out rows, which have the same past."""

    machine: SimulatedMachine
    specimen: Specimen
    campaign: Campaign
    held: Campaign
    whole: Campaign

    @classmethod
    def draw(
        cls, machine: SimulatedMachine, specimen: Specimen, plan: Plan, rng: np.random.Generator
    ) -> Setup:
        """A campaign by the plan, and later rows at ends of ranges, beyond its loads and temperatures."""
        campaign = machine.campaign(plan, rng)
        whole = joined(campaign, machine.campaign(replace(HELD_OUT, moving=plan.moving), rng))
        return cls(machine, specimen, campaign, _rest(whole, len(campaign)), whole)

    def exact(self, imperfections: Sequence[Imperfection]) -> tuple[Array, Array]:
        """Readings (n, k) of the campaign and (h, k) of the held-out rows, without noise, mm and rad."""
        observed = self.machine.measure(self.specimen, tuple(imperfections), self.whole)
        return observed[: len(self.campaign)], observed[len(self.campaign) :]

    @cached_property
    def clean(self) -> Array:
        """(n, k) readings of the campaign without imperfection or noise."""
        return self.exact(())[0]

    @cached_property
    def read(self) -> tuple[Machine, Recording]:
        """The drawing and the clean recording, through the files that the engine would read."""
        return self.loaded(self.machine.machine_text(), self.clean)

    def loaded(self, machine_text: str, observed: Array) -> tuple[Machine, Recording]:
        """A drawing and the campaign with these readings (n, k), through the files that the engine would read."""
        with tempfile.TemporaryDirectory() as folder:
            at = Path(folder)
            (at / "machine.yaml").write_text(machine_text, encoding="utf-8")
            text = recording_text(self.machine, self.campaign, observed)
            (at / "recording.csv").write_text(text, encoding="utf-8")
            loaded = load_machine(at / "machine.yaml")
            return loaded, load_recording(loaded, [at / "recording.csv"])

    @property
    def sigma(self) -> Array:
        """(k,) true sigma of each column, mm and rad."""
        return np.array([channel.sigma for channel in self.read[0].channels])

    @cached_property
    def free(self) -> tuple[Constant, ...]:
        """What the drawing leaves open."""
        return constants(self.read[0], self.specimen)

    @cached_property
    def slopes(self) -> Array:
        """(n + h, k, f) derivative of the readings by the open constants' steps, held-out rows last."""
        return by_constants(self.machine, self.specimen, self.whole, self.free)

    @cached_property
    def bench(self) -> Adaptation:
        """What geometry can make of changes of these readings."""
        n = len(self.campaign)
        fitted = ~self.campaign.validation
        return Adaptation(self.machine.columns, self.clean, self.sigma, self.slopes[:n], self.free, fitted)

    @cached_property
    def known(self) -> Imitations | None:
        """What the catalogue could say; None where the product's model does not hold."""
        try:
            return Imitations(*self.read, self.specimen, self.bench)
        except TrueposeError:
            return None

    def change(self, imperfection: Imperfection) -> Array:
        """(N,) whitened change of the fitted readings that an imperfection makes."""
        return self.bench.change(self.exact((imperfection,))[0])


class Setups:
    """The setups of one case: the same specimen, one campaign for each plan that kinds of imperfection ask for."""

    def __init__(self, machine: SimulatedMachine, specimen: Specimen, seed: int, *, sessions: int) -> None:
        self.machine, self._specimen, self._seed, self._sessions = machine, specimen, seed, sessions
        self._known: dict[Plan, Setup] = {}

    def of(self, kinds: Sequence[Kind]) -> Setup:
        """A setup that shows all of these kinds: with sessions and velocities where one of them needs them."""
        needs = {Driver.of(need).kind for kind in kinds for need in kind.needs}
        sessions = 2 if "session" in needs else self._sessions
        plan = Plan(sessions=sessions, moving="velocity" in needs)
        if plan not in self._known:
            rng = np.random.default_rng([self._seed, plan.sessions, int(plan.moving)])
            self._known[plan] = Setup.draw(self.machine, self._specimen, plan, rng)
        return self._known[plan]


def _rest(whole: Campaign, first: int) -> Campaign:
    """The rows from ``first`` on, as a campaign of their own."""
    arrays = ("q", "time", "pose", "approach", "session", "payload", "pressure", "validation")
    part = {name: getattr(whole, name)[first:] for name in arrays}
    return replace(
        whole,
        **part,
        temperatures={place: values[first:] for place, values in whole.temperatures.items()},
        origin=whole.origin[first:] - first,
        velocity=None if whole.velocity is None else whole.velocity[first:],
        dwell=None if whole.dwell is None else whole.dwell[first:],
    )


__all__ = ["Setup", "Setups"]
