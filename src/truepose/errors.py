"""Errors a user can mend: one base class, so that a caller catches them in one place.

A message says what was wrong, what was found, what was expected, and where (file, row, column).
"""

from __future__ import annotations


class TrueposeError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(TrueposeError):
    """A file, a field or an argument is not what was expected (exit code 2)."""


class ConvergenceError(TrueposeError):
    """A fit did not converge; the message names the parameters responsible (exit code 3)."""
