"""A camera's lens that draws points away from the axis, or towards it."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import sensor_at, sensors_where
from truepose.models.effects.sights import moved_point, point_names, seen_point
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import COUNT, SWITCH, ranges

BY_CAMERA = ("targets", "pose")
NOWHERE = 1e-12


@effects.add("lens-distortion")
class LensDistortion(Effect):
    """What is left of radial distortion: points move across the sensor frame's z axis, the optical axis.

    r is the tangent of a point's angle off the axis. Beyond 45 degrees, and behind the origin, no camera looks; r
    stays 1 there. Setting ``terms``: k1 alone, or k1 and k2; ``decentred`` 1: p1 and p2 too, of lenses that do not stand
    on one axis, or whose axis is not quite the sensor's z axis. One view stands for the whole network of pictures. A
    part of k1 r^2 that is alike for all points is a scale across the axis: only its change over the picture, by
    targets far apart or moves across the field, tells a lens from ``sensor-scale``; k1 and k2 need a wide field.
    """

    slug = "lens-distortion"
    setting_ranges = ranges({"terms": COUNT, "decentred": SWITCH})
    driven_by = "sensor"
    title = "Distortion of a lens"
    formula = (
        "X, Y + (k1 r^2 + k2 r^4) (X, Y), r^2 = x^2 + y^2, x = X / Z, y = Y / Z in the sensor's frame; decentred "
        "X + Z (p1 (r^2 + 2 x^2) + 2 p2 x y), Y + Z (2 p1 x y + p2 (r^2 + 2 y^2))"
    )
    size = "1 : 1e5 of the size of the object in a good network of pictures"
    look_alikes = ("sensor-scale", "target-offset", "platform-deformation")
    experiment = "turn the camera about its axis, or move the same targets through the corners of the picture"
    source = "radial and decentring terms of Brown 1971, Close-range camera calibration; size recalled"

    def places(self, machine: Machine) -> Sequence[Place]:
        return sensors_where(machine, lambda sensor: sensor.type in BY_CAMERA)

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        terms = range(1, round(settings.get("terms", 1.0)) + 1)
        radial = [Coefficient(f"k{k}", "1", 1e-3, -0.1, 0.1) for k in terms]
        if not settings.get("decentred"):
            return tuple(radial)
        return (*radial, *(Coefficient(f"p{k}", "1", 1e-4, -0.01, 0.01) for k in (1, 2)))

    def shifts(self, site: Site) -> Shifts:
        out: dict[str, ca.SX] = {}
        for name in point_names(sensor_at(site.machine, site.place[0])):
            x, y, z = ca.vertsplit(seen_point(site, name))
            aside = x**2 + y**2
            depth = ca.fmax(ca.fmax(z, 0.0) ** 2, aside) + NOWHERE
            square = aside / depth
            factor = sum((c * square ** int(k[1:]) for k, c in site.c.items() if k[0] == "k"), ca.SX(0))
            moved = ca.vertcat(factor * x, factor * y, 0.0)
            if "p1" in site.c:
                p1, p2 = site.c["p1"], site.c["p2"]
                turned = ca.vertcat(
                    p1 * (aside + 2 * x**2) + 2 * p2 * x * y, 2 * p1 * x * y + p2 * (aside + 2 * y**2), 0.0
                )
                moved += turned / ca.sqrt(depth)
            out |= moved_point(name, moved)
        return out

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        return ({"terms": 1.0}, {"terms": 2.0}, {"terms": 2.0, "decentred": 1.0})

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        return "The lens moves points away from the sensor's z axis (k1 > 0) or towards it, more the farther off they are."
