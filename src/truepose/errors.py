"""Errors a user can mend: one base class, so that a caller catches them in one place.

A message says what was wrong, what was found, what was expected, and where (file, row, column).
"""

from __future__ import annotations

LONGEST = 1500
"""Characters of a message: what a hostile file holds is not repeated whole."""


class TrueposeError(Exception):
    """Base of every error this package raises on purpose.

    Its message is of bounded length, and letters that would drive a terminal are written out.
    """

    def __init__(self, message: str) -> None:
        shown = "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in message[: 4 * LONGEST])
        half = LONGEST // 2
        super().__init__(shown if len(shown) <= LONGEST else f"{shown[:half]} [...] {shown[-half:]}")


class InputError(TrueposeError):
    """A file, a field or an argument is not what was expected (exit code 2)."""


class ReadBackError(RuntimeError):
    """A fault of truepose: what it made for a file does not read as what it was made from, and was not written."""


class ConvergenceError(TrueposeError):
    """A fit did not converge; the message names the parameters responsible (exit code 3)."""
