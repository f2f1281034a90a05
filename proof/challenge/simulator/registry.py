"""The machines of the examination by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from .base import SimulatedMachine

NAMES = ("telescope", "telescope-targets", "nanopositioner", "polisher", "arm", "arm-targets", "stewart")


def _classes() -> Mapping[str, type[SimulatedMachine]]:
    from .arm import Arm, ArmTargets
    from .nanopositioner import Nanopositioner
    from .polisher import Polisher
    from .stewart import Stewart
    from .telescope import Telescope, TelescopeTargets

    known = (Telescope, TelescopeTargets, Nanopositioner, Polisher, Arm, ArmTargets, Stewart)
    return {machine.name: machine for machine in known}


class _Machines(Mapping[str, type[SimulatedMachine]]):
    """Classes by name, imported when the first one is asked for."""

    def __getitem__(self, name: str) -> type[SimulatedMachine]:
        if name not in NAMES:
            raise KeyError(f"found machine {name!r}, expected one of {', '.join(NAMES)}")
        return _classes()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(NAMES)

    def __len__(self) -> int:
        return len(NAMES)


MACHINES: Mapping[str, type[SimulatedMachine]] = _Machines()
