"""Ctrl-C and SIGTERM: where they may come in, and what is said then of the results.

What must not be done by halves stands in `undisturbed`: a signal that comes meanwhile is heard at its end. So a result is
published or it is not, and `told` can say which.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

ONCE = 1.0
"""Seconds in which signals are one: a terminal and `timeout` send theirs to a process and to its group."""


SOON = 0.05
"""Seconds after which one that was swallowed comes again."""


class Stopped(KeyboardInterrupt):
    """A signal asked the process to end. It passes wherever KeyboardInterrupt does."""


class Stopping:
    """The signal that came, if any, and what was written by then."""

    def __init__(self) -> None:
        self.number = 0
        self.listens = False
        """Whether signals come here at all."""
        self.written = list[str]()
        """Results that are in place."""
        self.left = ""
        """What a command that can go on later has to say of its state."""
        self._inside = list[None]()  # one entry a block: adding and taking away cannot be interrupted
        self._waits, self._last = False, float("-inf")
        self._gentle: str | None = None  # what is said of a first Ctrl-C that only asks
        self._asked = False

    def listen(self) -> None:
        """Hear signals from now on, with nothing written yet. One that the caller's shell has turned off stays so."""
        self.written.clear()
        for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGTERM, signal.SIG_DFL)):
            if signal.getsignal(number) == usual:
                signal.signal(number, self._heard)
        sys.unraisablehook = self._lost
        self.listens = True

    def over(self) -> None:
        """Nothing is left to be done: from now on a signal ends the process without a word."""
        for number in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(number) == self._heard:
                signal.signal(number, signal.SIG_DFL)

    def _heard(self, number: int, _: FrameType | None) -> None:
        now = time.monotonic()
        if now - self._last < ONCE:
            return
        if number == signal.SIGINT and self._gentle is not None and not self._asked:
            self._asked, self._last = True, now
            with contextlib.suppress(OSError):
                os.write(2, self._gentle.encode())
            return
        self.number, self._last = number, now
        if self._inside:
            self._waits = True
            return
        raise Stopped

    def _again(self) -> None:
        self._waits, self._last = False, float("-inf")
        self._send()

    def _send(self) -> None:
        """To the main thread, whichever this one is: what waits there wakes up."""
        if hasattr(signal, "pthread_kill"):
            signal.pthread_kill(threading.main_thread().ident or 0, self.number)
        else:
            signal.raise_signal(self.number)

    def _lost(self, what: Any) -> None:
        """What a destructor or a callback swallowed comes once more."""
        if self.number and issubclass(what.exc_type, KeyboardInterrupt):
            self._last = float("-inf")
            late = threading.Timer(SOON, self._send)  # raised here it would be lost again
            late.daemon = True
            late.start()
        elif not self.number:
            sys.__unraisablehook__(what)

    @contextlib.contextmanager
    def undisturbed(self) -> Iterator[None]:
        """Let a signal that comes during the block be heard at its end."""
        self._inside.append(None)
        try:
            yield
        finally:
            self._inside.pop()
            if self._waits and not self._inside:
                self._again()

    @contextlib.contextmanager
    def asked(self, text: str) -> Iterator[Callable[[], bool]]:
        """Let a first Ctrl-C during the block ask for an end only, which ``text`` acknowledges on standard error.

        Yields whether it came. A second one ends the command at once, and so does SIGTERM.
        """
        self._gentle, self._asked = text, False
        try:
            yield lambda: self._asked
        finally:
            self._gentle = None

    def told(self) -> str:
        """What stands where, in words."""
        if self.left:
            return f"stopped: {self.left}"
        if self.written:
            return f"stopped; written before: {', '.join(self.written)}"
        return "stopped; nothing was written"

    @property
    def code(self) -> int:
        """Exit code, as shells have it: 130 for Ctrl-C, 143 for SIGTERM."""
        return 128 + (self.number or signal.SIGINT)


stopping = Stopping()

__all__ = ["Stopped", "Stopping", "stopping"]
