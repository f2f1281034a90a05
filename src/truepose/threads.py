"""Work on several processors at once: linear algebra, CasADi and compiled C run beside each other in threads.

What is worked out does not depend on how many there are: pieces are the same, and come back in order, so that sums of
them are the same digit by digit. ``TRUEPOSE_THREADS`` says how many; by default one for each processor, a few at most.
"""

from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import ContextVar
from typing import Any, Generic, TypeVar, overload

import joblib

from truepose.errors import InputError

T = TypeVar("T")
R = TypeVar("R")
VARIABLE = "TRUEPOSE_THREADS"
MOST = 8
"""Threads unless more are asked for: each holds a block of rows in memory, and more would wait for the rest of the work."""

_single: ContextVar[bool] = ContextVar("single", default=False)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Let what runs in the block have one thread: where whole pieces of work run beside each other, each has one."""
    token = _single.set(True)
    try:
        yield
    finally:
        _single.reset(token)


def cores() -> int:
    """Processors that this process may use."""
    return int(joblib.cpu_count())


def processors() -> int:
    """How many threads work at once. Raises InputError where the variable is no number from 1 on."""
    if _single.get():
        return 1
    asked = os.environ.get(VARIABLE)
    if asked is None:
        return min(cores(), MOST)
    if not asked.isdecimal() or int(asked) < 1:
        raise InputError(f"{VARIABLE}: found {asked!r}, expected a number of threads, 1 or more")
    return int(asked)


def in_order(work: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
    """``work`` of each item, in their order; no more of them are worked out ahead than there are threads."""
    threads = min(processors(), len(items))
    if threads < 2:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(threads) as pool:
        waiting = deque[Future[R]]()
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


class Cached(Generic[R]):
    """A property that is worked out once. Until Python 3.12 ``functools.cached_property`` lets one thread at a time do so, of
    all objects of a class; here two that ask for the same one may both work it out."""

    def __init__(self, work: Callable[[Any], R]) -> None:
        self._work, self.__doc__ = work, work.__doc__

    @overload
    def __get__(self, instance: None, owner: type) -> Cached[R]: ...
    @overload
    def __get__(self, instance: object, owner: type) -> R: ...
    def __get__(self, instance: object, owner: type) -> Cached[R] | R:
        """Return what is worked out, which takes the property's place in the object."""
        if instance is None:
            return self
        value = instance.__dict__[self._work.__name__] = self._work(instance)
        return value


def run_both(first: Callable[[], T], second: Callable[[], R]) -> tuple[T, R]:
    """Work out two results, which do not touch each other, at the same time where there are threads."""
    if processors() < 2:
        return first(), second()
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(second)
        return first(), other.result()


def all_done(work: Callable[[T], None], items: Sequence[T]) -> None:
    """``work`` of every item, which do not touch each other's results, shared out among the threads."""
    threads = min(processors(), len(items))

    def share(first: int) -> None:
        for item in items[first::threads]:
            work(item)

    for _ in in_order(share, range(threads)):
        pass


__all__ = ["Cached", "all_done", "cores", "in_order", "one_thread", "processors", "run_both"]
