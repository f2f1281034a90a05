"""What carries and ends the legs of a parallel machine: flexures and the platform."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import atan2, tau

import casadi as ca

from truepose.models.effects.base import (
    NO_SETTINGS,
    Coefficient,
    DriverKind,
    Effect,
    Observed,
    Place,
    Settings,
    Shifts,
    Site,
    effects,
)
from truepose.models.effects.common import limb_at, singly_and_together, travel_from_home
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Limb
from truepose.models.machine.placed import NOT_NEGATIVE, ranges


@effects.add("flexure-shift")
class FlexureShift(Effect):
    """Flexures in place of ball joints: their centre moves as they bend.

    A leg grows by k times the squared tilt of both its flexures against home; one leg or all alike.

    A flexure of constant section and length l in pure bending has k = l / 12. Where the machine's model has bent
    flexures already (``model: beam``), k is what they deviate by. A notch may have either sign.
    """

    slug = "flexure-shift"
    setting_ranges = NO_SETTINGS
    title = "Flexure whose centre moves"
    counted = True
    sentence = "The flexures of {all} shift their centres as they bend, with the square of the tilt."
    formula = (
        "dl = k (theta_a^2 + theta_b^2), theta^2 = |n - n_home|^2, n the leg's direction seen from either end"
    )
    size = "k = l / 12 for a flexure of length l: 2.5 mm for 30 mm, which makes 1 um at 0.02 rad"
    look_alikes = ("joint-runout", "wrong-constant", "platform-deformation")
    experiment = "large tilts of the platform to either side: the shift is even in the tilt"
    source = "beam theory as in Gayral and Daney 2012, INRIA RR-8096, section 4.3 (truepose.models.machine.assembly)"

    def places(self, machine: Machine) -> Sequence[Place]:
        if machine.mechanism.loops != "exact":
            return []
        rods = {rod.name for rod in machine.mechanism.rods}
        return singly_and_together(limb.name for limb in machine.mechanism.limbs if limb.name in rods)

    def screened(self, machine: Machine, place: Place) -> bool:
        return machine.mechanism.flexure_length is not None

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return (Coefficient("k", "mm", scale=(machine.mechanism.flexure_length or 20.0) / 2),)

    def shifts(self, site: Site) -> Shifts:
        limbs = [limb_at(site.machine, name) for name in site.place]
        return {limb.length: site.c["k"] * _squared_tilts(site, limb.name) for limb in limbs}

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        length = 12 * values["k"]
        beyond = "Beyond what the model has, the shift is that of flexures of constant section"
        return f"{beyond}, {length:.0f} mm long." if length >= 1 else ""


def _squared_tilts(site: Site, rod: str) -> ca.SX:
    """Sum over both ends of a rod of the squared chord between its direction and that at home."""
    home = site.machine.mechanism.home_directions
    ends = [f"{rod}.{end}" for end in "ab"]
    return sum((ca.sumsqr(site.direction(end) - ca.DM(home[end])) for end in ends), ca.SX(0))


COMMON, DIAGONAL, FULL, SYMMETRIC, WEIGHT, RECIPROCAL = 0, 1, 2, 3, 4, 5
LARGEST = 0.03
SOFTEST = 1e-3
"""mm/N: a leg end that gives way by 10 um under 10 N."""
_SAME_ANGLE = 0.02
Pair = tuple[int, int]


@effects.add("platform-deformation")
class PlatformDeformation(Effect):
    """A platform that bends: leg ends move along its normal as the actuators move, or under the legs' forces.

    db_i = sum_j K[i,j] drho_j along the platform's normal z, drho the actuators' travel from home, or
    db_i = sum_j C[i,j] F_j, F the force of gravity at the leg ends along the normal.

    Setting ``form``: 0 one diagonal entry for all legs (kappa), 1 a diagonal entry a leg, 2 the full matrix,
    3 the matrix of a platform as symmetric as its leg ends: as many entries as legs, those of the first row;
    4 the same symmetry under load (one compliance ``C`` for each leg's own end where there is none);
    5 any platform under load: by Maxwell's reciprocity C[i,j] = C[j,i].
    """

    slug = "platform-deformation"
    setting_ranges = ranges({"form": NOT_NEGATIVE})
    title = "Platform that bends"
    counted = True
    sentence = (
        "The ring or plate that carries the leg ends bends: each end moves along the platform's normal in "
        "proportion to the actuators' travel, or to the forces of the legs."
    )
    formula = (
        "db_i,z = sum_j K[i,j] drho_j; K = kappa 1, diagonal, full, or with the platform's symmetry; "
        "under load db_i,z = sum_j C[i,j] F_j,z"
    )
    size = "K of 0.01 to 0.02: tens of micrometres at 1.3 mm of travel (telescope)"
    look_alikes = ("actuator-scale", "wrong-constant", "leg-compliance", "axis-coupling")
    experiment = (
        "measure targets next to two or more leg ends, whose distances from the plane of the others change; "
        "gauge the travel of one actuator to exclude its scale; turn the machine over to see gravity's part"
    )
    source = "Gayral and Daney 2012, INRIA RR-8096, equations 1 to 4"
    # the entries add up: a symmetric part and what departs from it may stand together
    settings_add = True

    def places(self, machine: Machine) -> Sequence[Place]:
        limbs = machine.mechanism.limbs
        return [("platform",)] if len(_limbs(machine)) == len(limbs) > 1 else []

    def screened(self, machine: Machine, place: Place) -> bool:
        return machine.mechanism.flexure_length is not None or machine.loaded

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        names = dict.fromkeys(_entries(machine, settings).values())
        if self.reads_load(settings):
            own = {"C", *(f"C[{k},{k}]" for k in range(1, len(_limbs(machine)) + 1))}
            return tuple(
                Coefficient(name, "mm/N", SOFTEST, 0.0 if name in own else -float("inf")) for name in names
            )
        return tuple(Coefficient(name, "1", LARGEST) for name in names)

    def reads_load(self, settings: Settings) -> bool:
        return round(settings.get("form", COMMON)) in (WEIGHT, RECIPROCAL)

    def driver_kind(self, machine: Machine, place: Place, settings: Settings) -> DriverKind:
        """Return the legs' load, or the travel of the actuators, with which the flexures' forces grow."""
        return "load" if self.reads_load(settings) else "coupling"

    def shifts(self, site: Site) -> Shifts:
        limbs = _limbs(site.machine)
        if self.reads_load(site.settings):
            drive = [site.load(limb.platform_point[2]) for limb in limbs]
        else:
            drive = [travel_from_home(site, limb.reading) for limb in limbs]
        out = {limb.platform_point[2]: ca.SX(0) for limb in limbs}
        for (i, j), name in _entries(site.machine, site.settings).items():
            out[limbs[i].platform_point[2]] += site.c[name] * drive[j]
        return out

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        forms = [COMMON, DIAGONAL, SYMMETRIC, FULL] if _symmetry(machine) else [COMMON, DIAGONAL, FULL]
        if machine.mechanism.flexure_length is None:
            forms = []  # ball joints pass no moment on; flexures bend what they are fixed to
        forms += [WEIGHT, RECIPROCAL] if machine.loaded else []
        return [{"form": float(form)} for form in forms]


def _limbs(machine: Machine) -> list[Limb]:
    """Legs whose upper end has its three coordinates as parameters."""
    return [limb for limb in machine.mechanism.limbs if len(limb.platform_point) == 3]


def _entries(machine: Machine, settings: Settings) -> Mapping[Pair, str]:
    """Which coefficient stands at each entry (i, j) of K."""
    n, form = len(_limbs(machine)), round(settings.get("form", COMMON))
    if form == WEIGHT:
        classes = _symmetry(machine) or {(i, i): 0 for i in range(n)}
        return {pair: f"C[1,{first + 1}]" if len(classes) > n else "C" for pair, first in classes.items()}
    if form == RECIPROCAL:
        return {(i, j): f"C[{min(i, j) + 1},{max(i, j) + 1}]" for i in range(n) for j in range(n)}
    if form == COMMON:
        return {(i, i): "kappa" for i in range(n)}
    if form == DIAGONAL:
        return {(i, i): f"K[{i + 1},{i + 1}]" for i in range(n)}
    if form == SYMMETRIC:
        classes = _symmetry(machine)
        if classes:
            return {pair: f"K[1,{first + 1}]" for pair, first in classes.items()}
    return {(i, j): f"K[{i + 1},{j + 1}]" for i in range(n) for j in range(n)}


def _symmetry(machine: Machine) -> Mapping[Pair, int]:
    """Column of the first row that each entry (i, j) equals by symmetry; empty where the platform has none.

    Leg ends in pairs evenly round the platform: seen from leg i, looking towards its neighbour in the pair,
    all others stand at the same angles for every i.
    """
    nominal = machine.nominal_values
    at = [atan2(nominal[limb.platform_point[1]], nominal[limb.platform_point[0]]) for limb in _limbs(machine)]
    classes: dict[Pair, int] = {}
    for i, here in enumerate(at):
        gaps = [(angle - here + tau / 2) % tau - tau / 2 for angle in at]
        towards = 1 if min((abs(g), g) for k, g in enumerate(gaps) if k != i)[1] > 0 else -1
        seen = [(towards * gap + _SAME_ANGLE) % tau - _SAME_ANGLE for gap in gaps]
        if i == 0:
            first = seen
        for j, angle in enumerate(seen):
            same = [k for k, other in enumerate(first) if abs(other - angle) < _SAME_ANGLE]
            if len(same) != 1:
                return {}
            classes[i, j] = same[0]
    return classes
