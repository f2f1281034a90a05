"""Frames that the machine file says are set up anew for each session: what a recording of several sessions makes of them.

The frame in the file is that of the first session. Each later one has a stated ``frame-shift`` of the six parameters, part of
every model and no finding. ``calibrated.yaml`` holds them among its effects: ``predict`` knows every session of the fit.
"""

from __future__ import annotations

from collections.abc import Iterable

from truepose.identification.recording.recording import Recording
from truepose.models.effects.frame_shift import ANEW, FrameShift
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import PlacedEffect


def with_set_ups(machine: Machine, recording: Recording) -> Machine:
    """The machine with its frames set up anew after every session of the recording; itself where the file says nothing so."""
    if not machine.set_up:
        return machine
    steps = [
        PlacedEffect.at(FrameShift(), machine, (frame,), _settings(session))
        for frame in machine.set_up
        for session in range(1, recording.n_sessions)
    ]
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
