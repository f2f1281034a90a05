"""Angles recorded from 0 to 360 degrees, of joints whose range nobody states.

A joint that stands at -10 degrees and is logged as 350 seems to have turned by a whole turn: a gain, play or drag would be
taken for something else. Readings within one turn from zero are brought to the half turn on either side of zero, unless
that splits an arc that is whole as it was recorded.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification.recording.recording import Recording, frozen
from truepose.models.machine import Machine

Array = NDArray[np.float64]
TURN = 2.0 * np.pi
WHOLE_ARC = 0.9
"""Share of the arc about zero below which the arc as recorded is the one that was travelled."""


def center_turns(machine: Machine, recording: Recording) -> Recording:
    """Return the recording with angles from 0 to 360 degrees brought to -180 to 180, and a note, where no range is stated."""
    q, turned = recording.q.copy(), list[str]()
    for actuator in machine.mechanism.actuators:
        if actuator.range is not None or actuator.reading_unit != "rad":
            continue
        column = recording.joints.index(actuator.reading)
        angle = _centered(q[:, column])
        if angle is not None:
            q[:, column] = angle
            turned.append(actuator.reading)
    if not turned:
        return recording
    note = (
        f"{', '.join(turned)}: readings from 0 to 360 deg are taken as -180 to 180 deg; state a `range` for a joint that "
        "turns otherwise"
    )
    return replace(recording, q=frozen(q), notes=(*recording.notes, note))


def _centered(angle: Array) -> Array | None:
    """Return readings (n,) between minus and plus half a turn; None where they are whole as they were recorded."""
    if not len(angle) or angle.min() < 0.0 or angle.max() > TURN or angle.max() <= 0.5 * TURN:
        return None
    centered = np.where(angle > 0.5 * TURN, angle - TURN, angle)
    return None if np.ptp(angle) < WHOLE_ARC * np.ptp(centered) else centered


__all__ = ["center_turns"]
