"""What a plug-in's formulas must be: of the right shape, and numbers somewhere. Only those of a user's file are checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

POINTS = (0.5, -0.5, 0.1, 1.7)
"""Values that all symbols are given: a formula need not hold at each, but where it holds at none it is no number."""


def no_formula(given: Any, size: int) -> str:
    """What is wrong with a column of so many expressions; empty where nothing is."""
    try:
        column = ca.SX(given)
    except Exception:  # CasADi has an error of its own for each type
        return f"{_shown(given)}, expected {_column(size)}"
    if column.shape != (size, 1):
        return f"an expression of shape {column.shape}, expected {_column(size)}"
    if not _is_number(column):
        return "a formula that is no number wherever it was tried (NaN or infinite), expected finite values"
    return ""


def no_shifts(given: Any, _: Any) -> str:
    """What is wrong with the shifts of an effect."""
    if not isinstance(given, Mapping):
        return f"{_shown(given)}, expected a mapping from ports to expressions"
    for port, shift in given.items():
        if not isinstance(port, str):
            return f"the port {_shown(port)}, expected a name"
        wrong = no_formula(shift, 1)
        if wrong:
            return f"at the port {port!r} {wrong}"
    return ""


def no_prediction(given: Any, sensor: Any) -> str:
    """What is wrong with the prediction of a sensor's columns."""
    return no_formula(given, len(sensor.columns))


def no_residual(given: Any, sensor: Any) -> str:
    """What is wrong with the residual of a sensor's channels."""
    return no_formula(given, len(sensor.channels))


def no_readings(given: Any, sensor: Any) -> str:
    """What is wrong with numbers for a sensor's columns, row by row."""
    size = len(sensor.columns)
    if isinstance(given, np.ndarray) and given.ndim == 2 and given.shape[1] == size:
        return ""
    shape = f"an array of shape {given.shape}" if isinstance(given, np.ndarray) else _shown(given)
    return f"{shape}, expected an array of rows by {size} columns"


def _is_number(column: ca.SX) -> bool:
    """Whether every entry is finite at one of the points at least."""
    symbols = ca.vertcat(*ca.symvar(column))
    value = ca.Function("value", [symbols], [column])
    tried = np.hstack([np.array(value(np.full(symbols.shape, at))) for at in POINTS])
    return bool(np.isfinite(tried).any(axis=1).all())


def _column(size: int) -> str:
    return "an expression" if size == 1 else f"a column of {size} expressions"


def _shown(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:60]} ..."
