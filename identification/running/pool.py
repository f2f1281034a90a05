"""Tasks on several processes by joblib: on the cores of this computer (``loky``), or on those of a Dask cluster.

A process that dies takes nothing with it but its own task. Whichever tasks may have been at work then are tried again, one
after the other, each with nothing beside it; one that kills its process there, too, is given up. All others go on.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import joblib

from truepose.errors import InputError
from truepose.version import VERSION

if TYPE_CHECKING:
    from distributed import Client

T = TypeVar("T")
R = TypeVar("R")
CONNECTING = 30.0
"""Seconds that a cluster has to answer."""


@dataclass(frozen=True)
class Cores:
    """Processes on this computer, each with one thread of linear algebra."""

    workers: int
    deaths: tuple[type[Exception], ...] = (BrokenProcessPool,)

    def parallel(self, at_once: int) -> joblib.Parallel:
        """At most so many tasks at once. Of one alone joblib would make none in a process of its own: two stand ready."""
        with joblib.parallel_config(backend="loky", inner_max_num_threads=1):
            return joblib.Parallel(
                max(at_once, 2), pre_dispatch=at_once, batch_size=1, return_as="generator_unordered"
            )


@dataclass(frozen=True)
class Cluster:
    """Workers of Dask, as many as there are while it runs."""

    client: Client

    @property
    def workers(self) -> int:
        """Threads of all workers; at least one, for which is waited."""
        return max(sum(self.client.nthreads().values()), 1)

    @property
    def deaths(self) -> tuple[type[Exception], ...]:
        """What is raised for a task whose workers died."""
        from distributed.scheduler import KilledWorker

        return (KilledWorker,)

    def parallel(self, at_once: int) -> joblib.Parallel:
        """Two tasks for each thread are on their way, so that none waits for the network."""
        with joblib.parallel_config(backend="dask", client=self.client):
            return joblib.Parallel(
                pre_dispatch=min(at_once, 2 * self.workers), batch_size=1, return_as="generator_unordered"
            )


@contextlib.contextmanager
def cluster(address: str) -> Iterator[Cluster]:
    """The Dask cluster whose scheduler has this address. Raises InputError where there is none with this truepose."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "--dask: Dask is not installed, expected the extra dask: pip install 'truepose[dask]'"
        ) from None
    try:
        client = Client(address, timeout=CONNECTING)
    except (OSError, ValueError) as exc:
        raise InputError(f"--dask {address}: found no scheduler there: {exc}") from None
    with client:
        for worker, version in _versions(client, address).items():
            if version != VERSION:
                raise InputError(f"--dask {address}: found truepose {version} on {worker}, expected {VERSION} on all")
        yield Cluster(client)


def _versions(client: Client, address: str) -> dict[str, str]:
    try:
        found: dict[str, str] = client.run(_version)
    except Exception as exc:  # whatever a worker raises that has no truepose
        raise InputError(f"--dask {address}: found a worker without truepose {VERSION}: {exc}") from None
    return found


def _version() -> str:
    return VERSION


Pool = Cores | Cluster


def each(work: Callable[[T], R], tasks: Sequence[T], pool: Pool) -> Iterator[tuple[T, R | None]]:
    """Every task with its result, in the order in which they are done; None for one whose process died twice."""
    waiting, suspects = list(range(len(tasks))), deque[int]()
    while waiting or suspects:
        alone = bool(suspects)
        now = [suspects.popleft()] if alone else waiting
        if not alone:
            waiting = []
        running = _Running(work, tasks, now)
        try:
            for k, result in running.results(pool.parallel(1 if alone else pool.workers)):
                yield tasks[k], result
        except pool.deaths:
            if alone:
                yield tasks[now[0]], None
            else:
                suspects.extend(running.begun)
                waiting = running.left


class _Running(Generic[T, R]):
    """Tasks on their way: which have begun, and which are left."""

    def __init__(self, work: Callable[[T], R], tasks: Sequence[T], numbers: Sequence[int]) -> None:
        self._work, self._tasks = work, tasks
        self._open = deque(numbers)
        self._begun = dict[int, None]()

    def results(self, parallel: joblib.Parallel) -> Iterator[tuple[int, R]]:
        for k, result in parallel(self._calls()):
            del self._begun[k]
            yield k, result

    def _calls(self) -> Iterator[Any]:
        while self._open:
            k = self._open.popleft()
            self._begun[k] = None
            yield joblib.delayed(_numbered)(self._work, self._tasks[k], k)

    @property
    def begun(self) -> list[int]:
        """Those that were handed out, without a result."""
        return list(self._begun)

    @property
    def left(self) -> list[int]:
        """Those that were not."""
        return list(self._open)


def _numbered(work: Callable[[T], R], task: T, number: int) -> tuple[int, R]:
    return number, work(task)


__all__ = ["Cluster", "Cores", "Pool", "cluster", "each"]
