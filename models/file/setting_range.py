"""What the settings of an effect may be: another name is a slip, a number out of range a formula without a value or an end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from truepose.errors import InputError
from truepose.models.file.limits import LARGEST, LATEST
from truepose.wording import close_matches


@dataclass(frozen=True)
class Allowed:
    """Numbers from ``low`` to ``high``; ``zero``: 0 among them; ``whole``: no fractions."""

    low: float = -LARGEST
    high: float = LARGEST
    zero: bool = True
    whole: bool = False

    def __contains__(self, value: float) -> bool:
        inside = self.low <= value <= self.high and (self.zero or value != 0.0)
        return inside and (not self.whole or value == round(value))

    def __str__(self) -> str:
        number = "a whole number" if self.whole else "a number"
        return f"{number} from {self.low:g} to {self.high:g}{'' if self.zero else ' that is not 0'}"


ANY: Final = Allowed()
COLUMN: Final = Allowed(-LATEST, LATEST)
"""Values of a logged column: nanoseconds since 1970 are one."""
DURATION: Final = Allowed(0.0, LATEST)
"""Differences of two values of a logged column."""
SWITCH: Final = Allowed(0.0, 1.0)
NOT_NEGATIVE: Final = Allowed(low=0.0)
POSITIVE: Final = Allowed(low=1e-12)
ORDER: Final = Allowed(-1e4, 1e4, zero=False)
"""How often something repeats in a turn or a pitch."""
COUNT: Final = Allowed(1.0, 60.0, whole=True)
"""Terms of a series, degrees of a polynomial: each is a column of every fit."""
HARMONIC: Final = Allowed(1.0, 180.0, whole=True)
"""Orders of a long series: time and memory of a fit grow as the square of their number."""
SettingRanges = Mapping[str, Allowed]
"""By name; a name that ends with a dot stands for all that begin with it: ``from.``."""


def ranges(known: Mapping[str, Allowed]) -> SettingRanges:
    """Of an effect, for its class."""
    return MappingProxyType(dict(known))


NO_SETTINGS: Final = ranges({})


def check_settings(effect: str, known: SettingRanges, settings: Mapping[str, float], where: str) -> None:
    """Refuse settings that an effect does not have, or that are out of range. Raises InputError."""
    for name, value in settings.items():
        allowed = known.get(name) or known.get(f"{name.partition('.')[0]}.")
        if allowed is None:
            hint = close_matches(name, known) or "it has none"
            raise InputError(f"{where}: {effect} has no setting {name!r}; {hint}")
        if value not in allowed:
            raise InputError(f"{where}: found {name}: {value:g}, expected {allowed}")
