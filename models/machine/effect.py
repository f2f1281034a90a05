"""What a physics effect is: shifts at named ports as a function of coefficients, drivers and loads.

To add one, write a file like those in ``truepose.models.effects``: a class with a ``slug``, ``places``,
``coefficients`` and ``shifts``, registered with ``@effects.add(slug)``. Screening, naming, reporting,
prediction and the generated C follow from it. At zero coefficients the machine is untouched.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca

from truepose.errors import InputError
from truepose.models.machine.assembly import displacement_of
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import recorded_reading
from truepose.models.machine.placed import Effect, Place, Settings
from truepose.models.registry import Registry


@dataclass(frozen=True)
class Site:
    """Symbols an effect may use at its place; drivers in internal units.

    ``q`` are the joints' own motions in the units of their columns: what others add to coupled readings is not in them.
    """

    machine: Machine
    place: Place
    settings: Settings
    c: Mapping[str, ca.SX]
    q: Mapping[str, ca.SX]
    z: Mapping[str, ca.SX]
    values: Mapping[str, ca.SX]
    loads: Mapping[str, ca.SX] = field(default_factory=dict)
    states: Mapping[str, ca.SX] = field(default_factory=dict)

    def displacement(self, reading: str) -> ca.SX:
        """Displacement of a joint before the effect, mm or rad."""
        return displacement_of(self.machine, reading, self.values, self.q)

    def moved(self, reading: str) -> ca.SX:
        """Displacement that the reading alone makes: gain * own motion, mm or rad."""
        return self._gain(reading) * self.q[reading]

    def read(self, reading: str) -> ca.SX:
        """What the joint's encoder turns or slides, mm or rad: gain * recorded reading."""
        return self._gain(reading) * recorded_reading(self.machine.mechanism, reading, self.q)

    def _gain(self, reading: str) -> ca.SX:
        actuator = self.machine.mechanism.actuator(reading)
        return self.values[actuator.gain] if actuator.gain else ca.SX(1)

    def port(self, reading: str) -> str:
        """Port that adds to a joint's displacement."""
        return self.machine.mechanism.actuator(reading).displacement

    def value(self, port: str) -> ca.SX:
        """Present value of a parameter; of a displacement port, the whole displacement."""
        known = self.machine.ports.get(port)
        return self.displacement(known.of) if known and known.kind == "displacement" else self.values[port]

    def driver(self, name: str) -> ca.SX:
        """A recorded driver (payload kg, temperature degC, time s, approach +-1 ...)."""
        return self.z[name]

    def load(self, port: str, case: str = "") -> ca.SX:
        """Conjugate load of all that pulls, at a port: N along lengths, N m about angles; a probe ``case`` is 1 kg.

        Raises InputError where the machine weighs nothing.
        """
        try:
            return self.loads[f"{case}{port}"]
        except KeyError:
            raise InputError(
                f"{self.machine.name}: found an effect of weight at {', '.join(self.place)}, but nothing there weighs "
                "anything; expected gravity and masses in the machine file"
            ) from None

    def direction(self, end: str) -> ca.SX:
        """(3,) unit vector along a universal or spherical joint's child, or along a rod at its end ``R.a``, ``R.b``,
        in the frame that the joint is fixed in (``truepose.models.machine.states``)."""
        return ca.vertcat(*(self.states[f"axis.{end}.{axis}"] for axis in "xyz"))

    def turn(self, joint: str) -> ca.SX:
        """Angle of a passive revolute joint, rad (``truepose.models.machine.states``)."""
        return self.states[f"turn.{joint}"]

    def seen(self, column: str) -> ca.SX:
        """What a sensor's column should read, mm or rad (the whole length where readings are changes)."""
        return self.states[f"seen.{column}"]

    def checked(self, port: str, who: object) -> str:
        """The port, if this machine has it."""
        if port not in self.values:
            close = difflib.get_close_matches(port, self.values, n=2)
            near = ", ".join(close) or "none"
            raise InputError(f"effect {who}: found no port {port!r} on {self.machine.name}; close: {near}")
        return port


effects: Registry[type[Effect]] = Registry("effect", "truepose.models.effects", Effect)
