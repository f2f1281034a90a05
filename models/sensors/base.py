"""What a sensor's file imports: the contract is in ``truepose.models.machine.sensor``."""

from truepose.arrays import Array
from truepose.models.machine.sensor import (
    TOOL,
    Channel,
    Comparison,
    Difference,
    Rows,
    Sensor,
    flange_of,
    sensors,
)

__all__ = [
    "TOOL",
    "Array",
    "Channel",
    "Comparison",
    "Difference",
    "Rows",
    "Sensor",
    "flange_of",
    "sensors",
]
