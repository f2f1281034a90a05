"""What evaluates a batch: compiled C where the work repays the compiler, else CasADi's virtual machine.

``engine_for`` decides by the work alone, so that results depend neither on chunks nor on what is in a cache.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import cache

FEWEST_ROWS = 50_000
"""Compiling costs some 0.2 ms an operation, the virtual machine 4 ns an operation and row."""
LEAST_WORK = 2e7
"""Rows times operations that repay the start of a compiler, a tenth of a second."""


@dataclass(frozen=True)
class Engine:
    """``compiled`` or ``virtual machine``, and why the latter; ``missed``: compiling would have been worth it."""

    name: str
    why: str = ""
    missed: bool = False

    def __str__(self) -> str:
        return f"{self.name} ({self.why})" if self.why else self.name

    @property
    def compiled(self) -> bool:
        """Whether C is asked for."""
        return self.name == "compiled"


def engine_for(rows: int, instructions: int) -> Engine:
    """The engine for so many scalar operations a row, at ``rows`` rows in all calls together."""
    if rows >= FEWEST_ROWS and rows * instructions >= LEAST_WORK:
        return Engine("compiled")
    return Engine("virtual machine", "too little work for a compiler")


def without_compiler(why: str) -> Engine:
    """The virtual machine in place of C that cannot be had; it is logged once for each reason."""
    log_once(why)
    return Engine("virtual machine", why, missed=True)


@cache
def log_once(why: str) -> None:
    """Tell that there is no C; once in a process for each reason."""
    logging.getLogger(__name__).warning(
        "%s: large recordings are evaluated by CasADi's virtual machine, more slowly", why
    )
