"""What drives each imperfection of the examination, in the words that a diagnosis has for drivers.

The catalogue's own word holds where a class states one; the rest was decided here once, from what the simulators do.
None: no single driver is the right one, so any is right at the right place.
"""

from __future__ import annotations

from collections.abc import Mapping

from challenge.solutions import Truth
from truepose.models.effects.base import effects
from truepose.models.file.driver import DriverKind

POSITION: tuple[DriverKind, ...] = ("position", "position-periodic")
"""One driver: the part's own position."""
LIBRARY: Mapping[str, DriverKind | None] = {
    "joint-compliance": "load",
    "link-bending": "load",
    "leg-compliance": "load",
    "gravity-sag": "load",
    "screw-windup": "load",
    "axis-flexure": "load",
    "platform-deformation": None,  # the legs' load, or the travel of the actuators
    "actuator-scale": "position",
    "axis-straightness": "position",
    "flexure-shift": "position",
    "backlash": "arrival",
    "friction-hysteresis": "arrival",
    "piezo-hysteresis": "arrival",
    "early-reading": "arrival",
    "piezo-creep": "time",
    "mount-drift": "time",
    "thermal-expansion": "temperature",
    "frame-shift": "session",
    "zero-shift": "session",
}
"""Effects of the catalogue whose class does not state its driver, by slug."""
OUTSIDE: Mapping[str, DriverKind | None] = {
    "stiffening-gear": "load",
    "dragged-hose": None,  # a pull, by the pose alone
    "heated-zero": "temperature",
    "rocking-base": "load",
    "mirror-error": "sensor",
    "slipping-clamp": None,  # load, with a memory of it
    "creeping-belt": None,  # all travel since the start
    "opening-preload": "load",
    "unwinding-screw": None,  # how the whole platform is turned
    "swaying-floor": "time",
    "seat-bowed-by-two-slides": None,  # its own slide and the neighbour's
    "hub-bolt-slips": "load",
    "rail-sags-with-heat-across": "temperature",
    "flexure-buckles": "position",
    "cable-pulls-tool": "position",
    "mirror-bowed": "sensor",
    "beam-post-breathes": None,  # heat, of the sensor itself
    "cable-between-tables": None,  # its own table and the next
    "clamp-slips": None,  # another joint, with a memory of it
    "hose-pulls-wrist": "coupling",
    "spline-slack": "load",
    "head-rocks-under-load": None,  # load, and a joint with a memory of it
    "gantry-bends-by-warm-limb": "temperature",
    "play-under-weight": "load",
    "loose-bearing": "load",
    "loose-flange": "load",
}
"""What the catalogue has no name for, by the simulators' kind."""


def driver_of(truth: Truth) -> str | None:
    """What drives a true imperfection; None where any driver is right."""
    return of_effect(truth.effect) if truth.effect else OUTSIDE.get(truth.kind)


def of_effect(slug: str) -> str | None:
    """What drives an effect of the catalogue, at any place."""
    stated = effects.get(slug, "driver").driven_by if slug in set(effects) else None
    return stated or LIBRARY.get(slug)


def agree(said: str, true: str | None) -> bool:
    """Whether a driver that was said is the true one."""
    return true is None or said == true or {said, true} <= set(POSITION)


__all__ = ["LIBRARY", "OUTSIDE", "agree", "driver_of", "of_effect"]
