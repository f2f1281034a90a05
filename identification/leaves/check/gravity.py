"""Tell whether joints give way along the gravity that the file states, or against it: a robot that hangs, said to stand.

A machine fits as it is drawn whichever way is down. But its joints give way along gravity, never against it: if compliances
that are all negative fit far better than any that are positive, gravity pulls the other way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.optimize import nnls

from truepose.identification.fit.standing_out import FAR
from truepose.identification.leaves.check.pair import USUAL
from truepose.identification.leaves.check.result import Found
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.weighing import (
    CERTAIN,
    Problem,
    Weighed,
    evidence,
    linearised,
    without,
)
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.compliance import KNEE, JointCompliance
from truepose.models.effects.turning import EncoderEccentricity
from truepose.models.machine.machine import Machine


def reversed_gravity(rig: Rig, weighed: Weighed, misfit: float) -> Iterator[Found]:
    """Yield a finding where joints give way against the stated gravity; ``misfit``: rms that is left without compliances.

    Certain alone is worth a word, and only where the other sign leaves nothing that needs a further cause.
    """
    machine = rig.machine
    joints = _compliances(machine, rig.recording)
    # other loads do not turn with gravity, and an effect of the file may have taken them into account
    others = machine.springs or machine.forces or any(e.needs_load for e in machine.effects)
    if weighed.stand.bad or not joints or others:
        return
    if not _is_certain(rig, weighed, misfit, 1.0):  # no compliance could make it so
        return
    stated, other = _left_by_sagging(rig, weighed, joints)
    if other > FAR or not _is_certain(rig, weighed, stated, other):
        return
    gravity = list(machine.gravity or ())
    mended = [0.0 - v for v in gravity]
    yield Found(
        "gravity-reversed",
        ("gravity",),
        f"joints give way against the stated gravity {_words(gravity)}: compliances leave {stated:.3g} sigma with it, and "
        f"{other:.3g} sigma with its other sign",
        f"look how the machine is mounted: 'gravity: {_words(mended)}' (in the base frame) if it hangs",
        "suspect",
        mend=lambda pair: pair.with_field(("gravity",), mended),
    )


def _words(vector: Sequence[float]) -> str:
    return f"[{', '.join(f'{v + 0.0:.6g}' for v in vector)}]"


def _compliances(machine: Machine, recording: Recording) -> list[PlacedEffect]:
    """Return compliances of each joint: one where masses are stated, else one for each body that may be heavy."""
    effect = JointCompliance()
    every = [
        PlacedEffect.at(effect, machine, at, settings)
        for at in effect.places(machine)
        if effect.screened(machine, at)
        for settings in effect.settings(machine, at, recording)
    ]
    return [one for one in every if one.needs_load and KNEE not in one.settings_map]


def _eccentric(machine: Machine) -> list[PlacedEffect]:
    """Return encoders that may be eccentric, where the file has no such effect yet."""
    effect, known = EncoderEccentricity(), {e.at_place for e in machine.effects}
    every = [PlacedEffect.at(effect, machine, at) for at in effect.places(machine)]
    return [one for one in every if one.at_place not in known]


def _is_certain(rig: Rig, weighed: Weighed, stated: float, other: float) -> bool:
    """Whether the other sign is certain, by what both leave beyond the noise of the instrument, in sigmas.

    What noise alone makes of the rms of so many readings is nothing left.
    """
    least = np.sqrt(2.0 / max(weighed.stand.residual.size, 1))
    beyond = [float(np.sqrt(max(size**2 - 1.0, least))) for size in (stated, other)]
    scene = weighed.hypothesis.scene
    gained = evidence(rig, scene, beyond[1], USUAL) - evidence(rig, scene, beyond[0], 1.0)
    return bool(gained > np.log(CERTAIN / (1.0 - CERTAIN)))


def _left_by_sagging(rig: Rig, weighed: Weighed, joints: Sequence[PlacedEffect]) -> tuple[float, float]:
    """Return the rms of readings and of departures that compliances leave, in sigmas: all of them positive, and all negative.

    Readings are linear about where a hypothesis settled: by constants, by compliances, and by the eccentricity of encoders,
    which bends for what looks like a compliance of either sign.
    """
    machine, stand, known = rig.machine, weighed.stand, len(rig.names)
    eccentric = _eccentric(machine)
    here = Predictor(machine, stand.scene.rows.subset(stand.rows), (*machine.effects, *eccentric, *joints))
    p = np.concatenate([weighed.settled.p, np.zeros(len(here.model.names) - known)])
    jacobian, residual = linearised(rig, here, p, stand)
    first = known + sum(len(e.coefficients) for e in eccentric)

    def left(sign: float, noise: float) -> float:
        problem = Problem(rig, stand, noise, weighed.free)
        places = problem.moving
        unit = np.ones(jacobian.shape[2])
        unit[places] = problem.scale
        held = np.zeros((len(places), len(unit)))
        held[np.arange(len(places)), places] = problem.held
        moved = np.vstack([jacobian.reshape(-1, len(unit)) * unit / noise, held])
        off = np.where(problem.known, problem.off(weighed.settled.p), 0.0)
        right = -np.concatenate([residual.reshape(-1) / noise, off])
        both = without(moved[:, [*places, *range(known, first)]], np.column_stack([moved[:, first:], right]))
        size = np.maximum(np.linalg.norm(both[:, :-1], axis=0), 1e-300)
        _, rest = nnls(sign * both[:, :-1] / size, both[:, -1])
        return float(noise * rest / np.sqrt(max(residual.size, 1)))

    stated, other = (left(sign, max(left(sign, 1.0), 1.0)) for sign in (1.0, -1.0))
    return stated, other
