"""A limit of time for a piece of work, in whatever thread it runs."""

from __future__ import annotations

import contextlib
import ctypes
import threading
from collections.abc import Iterator


class OverdueError(BaseException):
    """The time is over. No ``Exception``: nothing on the way that mends faults may take it for one."""


@contextlib.contextmanager
def within(minutes: float | None) -> Iterator[None]:
    """Raise OverdueError in the block after so many minutes; None: never.

    It is raised between two steps of Python: a call of compiled code comes to its end first.
    """
    if minutes is None:
        yield
        return
    thread, lock, over = threading.get_ident(), threading.Lock(), False

    def raise_there() -> None:
        with lock:
            if not over:
                ctypes.pythonapi.PyThreadState_SetAsyncExc(
                    ctypes.c_ulong(thread), ctypes.py_object(OverdueError)
                )

    timer = threading.Timer(60.0 * minutes, raise_there)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        with lock:  # what was raised before arrives in here at the latest
            over = True


__all__ = ["OverdueError", "within"]
