"""Frames that the machine file says are set up anew for each session: what a recording of several sessions makes of them.

The frame in the file is that of the first session. Each later one has a stated ``frame-shift`` of the six parameters, part of
every model and no finding. ``calibrated.yaml`` holds them among its effects: ``predict`` knows every session of the fit.

A fit of some constants alone: the model of one campaign on another, where only base and tool stand elsewhere.

What is not named is held as the machine file has it, effects included, and keeps what the file's covariance says of it. A
frame that is named may be anywhere, but for axes that are exactly known. What moved between sessions of the file's own campaign
stays where it was last.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from truepose.errors import InputError
from truepose.identification.fit.problem import Prior
from truepose.identification.prediction.covariance import Covariance, covariance_of_file
from truepose.identification.recording.recording import Recording
from truepose.models.effects.sessions import ANEW, FrameShift
from truepose.models.file.driver import Driver
from truepose.models.machine.machine import FRAME_OF, Machine
from truepose.models.machine.mechanism import Parameter
from truepose.models.machine.placed import PlacedEffect
from truepose.wording import close_matches


def with_set_ups(machine: Machine, recording: Recording) -> Machine:
    """The machine with its frames set up anew after every session of the recording; itself where the file says nothing so."""
    if not machine.set_up:
        return machine
    later = [_settings(session) for session in range(1, recording.n_sessions)]
    places = [((frame,), settings) for frame in machine.set_up for settings in later]
    steps = [PlacedEffect.at(FrameShift(), machine, *place) for place in places]
    return machine.with_effects((*without_set_ups(machine.effects), *steps))


def without_set_ups(effects: Iterable[PlacedEffect]) -> tuple[PlacedEffect, ...]:
    """The effects less the set-ups of earlier recordings."""
    return tuple(effect for effect in effects if not is_set_up(effect))


def is_set_up(effect: PlacedEffect) -> bool:
    """Whether it is a frame that was set up anew, as the file says."""
    return effect.effect.slug == FrameShift.slug and ANEW in effect.settings_map


def set_up_label(frame: str, session: int) -> str:
    """Label of what a frame changes by after the session of this 1-based rank."""
    return f"{FrameShift.slug}@{frame}{FrameShift().told(_settings(session))}"


def _settings(session: int) -> dict[str, float]:
    return {ANEW: 1.0, "session": float(session)}


OFFSET: Final = "offset"
"""What the zeros of all joints are called together, whatever each is called in its mechanism."""


def with_zeros(machine: Machine, only: Sequence[str]) -> tuple[str, ...]:
    """Return the names with ``offset`` as the zeros of all joints that are not exactly known, and ``J.offset`` as that of J."""
    free = {p.name: p.free for p in machine.parameters}
    zeros = {f"{a.reading}.offset": a.zero for a in machine.mechanism.actuators if a.zero in free}
    of_all = [zero for zero in zeros.values() if free[zero]]
    out = [of_all if name == OFFSET and of_all else [zeros.get(name, name)] for name in only]
    return tuple(dict.fromkeys(name for names in out for name in names))


def held_but(machine: Machine, only: Sequence[str]) -> Machine:
    """The machine with its effects held, and frames that are named known of nothing. Raises InputError for names without a
    constant, and for those that are exactly known."""
    for name in only:
        _check(machine, name)
    frames = tuple(
        replace(p, tolerance=math.inf) if p.free and _named(p.name, only) else p for p in machine.frames
    )
    return replace(machine, frames=frames, effects=_held(machine, only))


def prior_but(prior: Prior, machine: Machine, only: Sequence[str]) -> Prior:
    """The prior with everything but the constants named, and their set-ups, exactly known."""
    known = {p.name for p in machine.parameters if not _named(p.name, only)}
    set_ups = {
        name for e in machine.effects if is_set_up(e) for name in _axes(e) if _named(_axes(e)[name], only)
    }
    geometry = {p.name for p in machine.parameters} - known
    free = np.array([name in geometry or name in set_ups for name in prior.names])
    return prior.with_sigma(np.where(free, prior.sigma, 0.0))


def kept_covariance(machine: Machine, prior: Prior) -> Covariance | None:
    """What the file's covariance says of what ``prior`` holds; None where it says nothing."""
    known = covariance_of_file(machine)
    if known is None:
        return None
    held = {name for name, sigma in zip(prior.names, prior.sigma, strict=True) if sigma == 0.0}
    return known.of_names([name for name in known.names if name in held])


def _check(machine: Machine, name: str) -> None:
    own = [p for p in machine.parameters if _named(p.name, (name,))]
    if not own:
        elements = list(dict.fromkeys(p.name.partition(".")[0] for p in machine.parameters))
        hint = close_matches(name, [*elements, *machine.geometry])
        raise InputError(
            f"--only: found {name!r}, expected frames, parts or constants of {machine.name} such as base,tool; {hint}"
        )
    if not any(p.free for p in own):
        raise InputError(
            f"--only: found {name!r}, which {_where(machine, own[0])} has as exactly known; expected a tolerance above 0"
        )


def _where(machine: Machine, parameter: Parameter) -> str:
    file = str(machine.file.path) if machine.file else machine.name
    return f"{file}: frames" if parameter.name in FRAME_OF else f"{file}: tolerances"


def _named(name: str, only: Sequence[str]) -> bool:
    """Whether a constant is one of these, or of a part, or a vector, that is."""
    return any(name == one or name.startswith(f"{one}.") for one in only)


def _axes(effect: PlacedEffect) -> dict[str, str]:
    """The frame's constant that each coefficient of a set-up changes."""
    names = [f"{effect.place[0]}.{c.name}" for c in effect.coefficients]
    return dict(zip(effect.parameter_names, names, strict=True))


def _held(machine: Machine, only: Sequence[str]) -> tuple[PlacedEffect, ...]:
    """The file's effects as they are in the latest session, those of a frame that is found anew left out."""
    out: dict[str, PlacedEffect] = {}
    for effect in machine.effects:
        if effect.effect.slug == FrameShift.slug and effect.place[0] in only:
            continue
        now = replace(_latest(machine, effect), spread=0.0)
        earlier = out.get(now.label)
        if earlier is not None:
            pairs = zip(earlier.amplitudes, now.amplitudes, strict=True)
            now = now.with_values([a + b for a, b in pairs])
        out[now.label] = now
    return tuple(out.values())


def _latest(machine: Machine, effect: PlacedEffect) -> PlacedEffect:
    """A movement after session K as one that is always there: a campaign that is not the file's comes after its sessions."""
    if not any(Driver.of(name).after is not None for name in effect.drivers):
        return effect
    settings = {**effect.settings_map, "session": 0.0}
    return PlacedEffect.at(effect.effect, machine, effect.place, settings, effect.values)
