"""What several effects share: places by joint, leg and sensor, rails, periodic series, the recording's clock."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.machine.effect import Site
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES, Actuator, Direction, Joint, Limb
from truepose.models.machine.placed import Coefficient, Observed, Place, Settings
from truepose.models.machine.sensor import Sensor
from truepose.wording import joined

SECONDS_PER_HOUR = 3600.0
ARCSEC = 206264.8
LOADS = tuple(float(f"{10.0 ** (k / 5):.3g}") for k in range(13))
"""N*m, N: loads up to which friction holds or a gear is soft that are tried; what is found is refined between them."""
APPROACHES = (0.003, 0.006, 0.0125, 0.025, 0.05, 0.1)
"""How far behind its goal a joint may start its approach, as parts of its range."""


def actuator_at(machine: Machine, name: str) -> Actuator:
    """Actuator of a joint's reading, or of the leg of that name (``rho1``, ``leg1``: the same limb)."""
    reading = next((limb.reading for limb in machine.mechanism.limbs if limb.name == name), name)
    for actuator in machine.mechanism.actuators:
        if actuator.reading == reading:
            return actuator
    known = [*machine.mechanism.readings, *(limb.name for limb in machine.mechanism.limbs)]
    raise _unknown(machine, "joint", name, known)


def limb_at(machine: Machine, name: str) -> Limb:
    """Leg of that name, or the one that a reading of that name moves."""
    for limb in machine.mechanism.limbs:
        if name in (limb.name, limb.reading):
            return limb
    raise _unknown(machine, "leg", name, [limb.name for limb in machine.mechanism.limbs])


def sensor_names(machine: Machine) -> tuple[str, ...]:
    """Names of a machine's sensors as places: ``sensor``, or ``sensor1``, ``sensor2`` ... in the file's order."""
    count = len(machine.sensors)
    return ("sensor",) if count == 1 else tuple(f"sensor{k}" for k in range(1, count + 1))


def sensor_at(machine: Machine, name: str) -> Sensor:
    """Sensor of that name."""
    names = sensor_names(machine)
    if name not in names:
        raise _unknown(machine, "sensor", name, names)
    return machine.sensors[names.index(name)]


def sensors_where(machine: Machine, fits: Callable[[Sensor], bool]) -> list[Place]:
    """One place for each sensor that fits."""
    pairs = zip(sensor_names(machine), machine.sensors, strict=True)
    return [(name,) for name, sensor in pairs if fits(sensor)]


def singly(names: Iterable[str]) -> list[Place]:
    """One place a name."""
    return [(name,) for name in names]


def singly_and_together(names: Iterable[str]) -> list[Place]:
    """One place a name, then all of them with one common cause."""
    each = singly(names)
    return [*each, tuple(name for (name,) in each)] if len(each) > 1 else each


def drives_joint(machine: Machine, actuator: Actuator) -> bool:
    """Whether an actuator moves a joint that has error-motion ports (a rod's length has none)."""
    return machine.motion(actuator.reading, "x") in machine.ports


def own_offset(joint: Joint) -> tuple[str, ...]:
    """Lengths along a joint's own axis z that end its placement (r of a serial chain).

    They may as well follow the joint's motion, and count with the link that it moves: its bearing stands before them.
    """
    names: list[str] = []
    for step in reversed(joint.placement if joint.axis == (0.0, 0.0, 1.0) else ()):
        if step.kind not in ("tz", "rz"):
            break
        names += [step.parameter] if step.kind == "tz" else []
    return tuple(names)


def joint_unit(machine: Machine, place: Place) -> str:
    """Unit of the displacement at a joint place: mm or rad."""
    return actuator_at(machine, place[0]).unit


def centre_and_half(actuator: Actuator) -> tuple[float, float]:
    """Middle and half of the range of readings, in the column's unit; (0, 1) when no range is stated."""
    if actuator.range is None:
        return 0.0, 1.0
    low, high = actuator.range
    return (low + high) / 2, (high - low) / 2


def travel_from_home(site: Site, reading: str) -> ca.SX:
    """What a reading moves from home: from zero, or from mid-range where zero is out of range."""
    actuator = site.machine.mechanism.actuator(reading)
    centre, half = centre_and_half(actuator)
    if abs(centre) <= half:
        return site.moved(reading)
    gain = site.values[actuator.gain] if actuator.gain else 1
    return site.moved(reading) - gain * centre


def nominal_gain(machine: Machine, actuator: Actuator) -> float:
    """Displacement (mm or rad) a unit of the reading, in the nominal model."""
    return machine.nominal_values[actuator.gain] if actuator.gain else 1.0


def down(site: Site, joint: str) -> ca.SX:
    """(3,) which way gravity pulls, a unit vector in the frame of the body that a joint moves; weights cancel."""
    case = site.machine.weight_case
    force = ca.vertcat(*(site.load(f"{joint}.motion.{axis}", case) for axis in AXES[:3]))
    return force / ca.norm_2(force)


def carried(machine: Machine) -> str:
    """What its parts carry, in words."""
    names = joined([f"`{force.name}`" for force in machine.forces])
    if not names:
        return "the weight it carries"
    force = f"the measured force {names}"
    return f"the weight it carries and {force}" if machine.weighs or machine.springs else force


def points_only(machine: Machine) -> bool:
    """Whether a machine of known weight is seen by directions: a telescope's mount, whose weights in balance nobody states."""
    return machine.loaded and any(sensor.type == "direction" for sensor in machine.sensors)


def sine_pair(site: Site, phase: ca.SX) -> ca.SX:
    """a sin(phase) + b cos(phase): a sine of any phase, linear in its two coefficients."""
    return site.c["a"] * ca.sin(phase) + site.c["b"] * ca.cos(phase)


def sine_coefficients(unit: str, scale: float) -> tuple[Coefficient, ...]:
    """The two coefficients of a sine pair."""
    return (Coefficient("a", unit, scale), Coefficient("b", unit, scale))


def clock(recording: Observed) -> tuple[float, float] | None:
    """First and last time of a recording, s; None when no time is recorded."""
    time = recording.driver("time")
    if time is None:
        return None
    seconds = np.asarray(time, dtype=float)
    return float(seconds.min()), float(seconds.max())


def approaches(machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
    """One candidate for each distance that joints may approach their goals from; far off goes without one.

    Only where the sides are recorded do joints approach from other than their last pose.
    """
    side = f"approach.{actuator_at(machine, place[0]).reading}"
    recorded = recording.driver(side) is not None and not recording.inferred(side)
    return [{}, *({"overshoot": part} for part in APPROACHES)] if recorded else [{}]


def overshoot_of(actuator: Actuator, settings: Settings) -> str:
    """Last number of the name of a driver that remembers a joint's way, in the reading's unit; empty for far off."""
    low, high = actuator.range or (0.0, 1.0)
    return f"~{settings['overshoot'] * (high - low):.6g}" if "overshoot" in settings else ""


@dataclass(frozen=True)
class Rail:
    """A leg's straight guideway as the drawing has it: its axis, and which way its leg leans across it."""

    reading: str
    components: tuple[str | None, str | None, str | None]
    axis: Array
    across: Array


def rails(machine: Machine) -> list[Rail]:
    """Rails of the legs whose actuator slides along a direction that is itself a parameter.

    ``across`` (3,) is the unit vector across the rail towards the leg's upper end at home, in the base frame.
    """
    joints = {joint.name: joint for joint in machine.mechanism.joints}
    nominal = machine.nominal_values
    out = []
    for limb in machine.mechanism.limbs:
        joint = joints.get(machine.mechanism.actuator(limb.reading).drives)
        if joint is None or not isinstance(joint.axis, Direction):
            continue
        axis = nominal_axis(machine, joint.axis)
        upper = _on_base(machine, [nominal[n] for n in limb.platform_point])
        leg = upper - np.array([nominal[n] for n in limb.base_point])
        across = leg - (leg @ axis) * axis
        across /= np.linalg.norm(across) or 1.0
        out.append(Rail(limb.reading, joint.axis.components, axis, across))
    return out


def nominal_axis(machine: Machine, axis: tuple[float, float, float] | Direction) -> Array:
    """(3,) unit vector of a joint's axis as the drawing has it."""
    if not isinstance(axis, Direction):
        return np.array(axis, dtype=float)
    nominal = machine.nominal_values
    known = [0.0 if name is None else nominal[name] for name in axis.components]
    third = axis.sign * float(np.sqrt(1 - np.dot(known, known)))
    return np.array([third if name is None else nominal[name] for name in axis.components])


def _on_base(machine: Machine, point: Sequence[float]) -> Array:
    """A point of the platform in the base frame, at home."""
    mechanism = machine.mechanism
    home = next((j.home for j in mechanism.joints if j.kind == "free" and j.child == mechanism.platform), ())
    if not home:
        return np.array(point, dtype=float)
    turned = Rotation.from_mrp(home[3:]).apply(point)
    return np.asarray(turned + np.array(home[:3]), dtype=float)


def _unknown(machine: Machine, kind: str, name: str, known: Sequence[str]) -> InputError:
    close = difflib.get_close_matches(name, known, n=2)
    hint = f"; did you mean {' or '.join(close)}?" if close else ""
    expected = f"one of {', '.join(known)}" if known else f"a machine with a {kind}"
    return InputError(f"effect's place: found {name!r} on {machine.name}, expected {expected}{hint}")


OF_ROWS = ("outliers", "fringe-miscount")
"""Their slugs: findings of these alone say nothing against the model."""
