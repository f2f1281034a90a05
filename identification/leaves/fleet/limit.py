"""A limit of time for a piece of work, in whatever thread it runs."""

from __future__ import annotations

import contextlib
import ctypes
import threading
from collections.abc import Iterator

AGAIN = 0.2
"""Seconds until what was lost is raised again: longer than a block takes to end."""


class OverdueError(BaseException):
    """The time is over. No ``Exception``: nothing on the way that mends faults may take it for one."""


@contextlib.contextmanager
def within(minutes: float | None) -> Iterator[None]:
    """Raise OverdueError in the block after so many minutes; None: never.

    It is raised between two steps of Python: a call of compiled code comes to its end first. What is raised inside a
    destructor or a callback is lost, so it is raised again until the block ends.
    """
    if minutes is None:
        yield
        return
    thread, lock, over = threading.get_ident(), threading.Lock(), threading.Event()

    def watch() -> None:
        over.wait(60.0 * minutes)
        while not over.is_set():
            with lock:
                if not over.is_set():
                    raised = ctypes.py_object(OverdueError)
                    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), raised)
            over.wait(AGAIN)

    watching = threading.Thread(target=watch, daemon=True)
    watching.start()
    try:
        yield
    finally:
        with lock:  # what was raised before arrives in here at the latest
            over.set()


__all__ = ["OverdueError", "within"]
