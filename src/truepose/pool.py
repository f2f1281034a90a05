"""Tasks on several processes: by joblib on the cores of this computer, by Dask on a cluster's.

A process that dies takes nothing with it but its own task. Those that may have been at work in it are tried again after all
others, one at a time with nothing beside it; one whose process dies then, too, is given up.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import uuid4

import joblib

from truepose.errors import InputError
from truepose.version import VERSION

if TYPE_CHECKING:
    from distributed import Client, Future

T = TypeVar("T")
R = TypeVar("R")
LIBRARIES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""What libraries of linear algebra read before they read OMP_NUM_THREADS."""
_LARGE = "distributed.admin.large-graph-warning-threshold"
CONNECTING = 30.0
"""Seconds that a cluster has to answer."""
WATCHED = 0.5
"""Seconds after which a process that works for another looks whether that one is there."""


class Pool(ABC):
    """Where tasks are worked with, ``workers`` of them at once."""

    @property
    @abstractmethod
    def workers(self) -> int:
        """How many are worked with at once."""

    @abstractmethod
    def results(
        self, work: Callable[[T], R], tasks: Mapping[int, T], at_once: int
    ) -> Iterator[tuple[int, R | None]]:
        """Tasks by number with their results, as they come; None for one that may have killed its process.

        What is not named when it ends was not begun, or what came of it was lost with another.
        """


@dataclass(frozen=True)
class Cores(Pool):
    """Processes on this computer, each with one thread of linear algebra."""

    number: int

    @property
    def workers(self) -> int:
        """As many as were asked for."""
        return self.number

    def results(
        self, work: Callable[[T], R], tasks: Mapping[int, T], at_once: int
    ) -> Iterator[tuple[int, R | None]]:
        """All processes end when one dies: whichever task was handed out may be to blame."""
        begun = dict[int, None]()

        def calls() -> Iterator[Any]:
            for k, task in tasks.items():
                begun[k] = None
                yield joblib.delayed(_numbered)(work, task, k)

        with joblib.parallel_config(
            backend="loky", inner_max_num_threads=1, initializer=end_with, initargs=(os.getpid(),)
        ):
            parallel = joblib.Parallel(  # of one alone joblib would make none in a process of its own: two stand ready
                max(at_once, 2), pre_dispatch=at_once, batch_size=1, return_as="generator_unordered"
            )
        try:
            for k, result in parallel(calls()):
                del begun[k]
                yield k, result
        except BrokenProcessPool:
            yield from ((k, None) for k in list(begun))


def end_with(parent: int) -> None:
    """Let this process end when its parent does: a worker of one that was killed would go on, and wait for work for minutes.

    Results are published in one step, so that it may end anywhere. Where a system names no other parent it waits.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCHED)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@dataclass(frozen=True)
class Cluster(Pool):
    """Workers of Dask, as many as there are while it runs.

    Not by joblib's own way to Dask, which waits for ever for a task whose worker has died (1.6.0).
    """

    client: Client

    @property
    def workers(self) -> int:
        """Threads of all workers."""
        return max(int(sum(self.client.nthreads().values())), 1)

    def results(
        self, work: Callable[[T], R], tasks: Mapping[int, T], at_once: int
    ) -> Iterator[tuple[int, R | None]]:
        """Two tasks for each thread are on their way, so that none waits for the network."""
        import dask
        from distributed import as_completed
        from distributed.scheduler import KilledWorker

        def submitted(k: int) -> Future:
            key = f"truepose-{k}-{uuid4().hex}"
            with dask.config.set({_LARGE: "1TB"}):  # each task goes once and is large for a reason
                return self.client.submit(_numbered, work, tasks[k], k, pure=False, key=key)

        waiting = iter(tasks)
        numbers = {
            future: k for k in islice(waiting, min(at_once, 2 * self.workers)) for future in [submitted(k)]
        }
        coming = as_completed(numbers)
        for future in coming:
            k = numbers.pop(future)
            try:
                yield future.result()
            except KilledWorker:
                yield k, None
            for following in islice(waiting, 1):
                numbers[new := submitted(following)] = following
                coming.add(new)


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
        yield check_cluster(client, f"--dask {address}")


def check_cluster(client: Client, where: str) -> Cluster:
    """Return the cluster of a client. Raises InputError where a worker has another truepose, or several threads."""
    for worker, (version, threads) in _states(client, where).items():
        if version != VERSION:
            raise InputError(f"{where}: found truepose {version} on {worker}, expected {VERSION} on all")
        if threads:
            raise InputError(
                f"{where}: found {threads} on {worker}, expected OMP_NUM_THREADS=1: with more threads of linear"
                " algebra results differ in their last digits. A worker that has a nanny starts so"
            )
    return Cluster(client)


def _states(client: Client, where: str) -> dict[str, tuple[str, str]]:
    """Of each worker the version of truepose, and what is wrong with its threads."""
    try:
        found: dict[str, tuple[str, str]] = client.run(_state)
    except Exception as exc:  # whatever a worker raises that has no truepose
        raise InputError(f"{where}: found a worker without truepose {VERSION}: {exc}") from None
    return found


def _state() -> tuple[str, str]:
    return VERSION, several_threads(os.environ)


def several_threads(environment: Mapping[str, str]) -> str:
    """The variable that lets linear algebra have more than one thread; empty where none does.

    Sums in several threads are rounded otherwise, so that files would depend on the computer that wrote them.
    """
    told = {name: environment.get(name, "") for name in ("OMP_NUM_THREADS", *LIBRARIES)}
    wrong = (name for name, value in told.items() if value != "1" and (value or name == "OMP_NUM_THREADS"))
    name = next(wrong, "")
    return name and (f"{name}={told[name]}" if told[name] else f"no {name}")


def each(work: Callable[[T], R], tasks: Sequence[T], pool: Pool) -> Iterator[tuple[T, R | None]]:
    """Every task with its result, in the order in which they are done; None for one whose process died twice."""
    for k, result in numbered(work, tasks, pool):
        yield tasks[k], result


def numbered(work: Callable[[T], R], tasks: Sequence[T], pool: Pool) -> Iterator[tuple[int, R | None]]:
    """The same with the number of each task, which is asked for only when it is begun."""
    left, suspects = dict.fromkeys(range(len(tasks))), list[int]()
    while left:
        for k, result in pool.results(work, _Some(tasks, tuple(left)), pool.workers):
            del left[k]
            if result is None:
                suspects.append(k)
            else:
                yield k, result
    for k in suspects:
        found = dict(pool.results(work, _Some(tasks, (k,)), 1))
        yield k, found.get(k)


@dataclass(frozen=True)
class _Some(Mapping[int, T]):
    """Some of the tasks, by number."""

    tasks: Sequence[T]
    numbers: tuple[int, ...]

    def __getitem__(self, number: int) -> T:
        return self.tasks[number]

    def __iter__(self) -> Iterator[int]:
        return iter(self.numbers)

    def __len__(self) -> int:
        return len(self.numbers)


def _numbered(work: Callable[[T], R], task: T, number: int) -> tuple[int, R]:
    return number, work(task)


__all__ = [
    "Cluster",
    "Cores",
    "Pool",
    "check_cluster",
    "cluster",
    "each",
    "end_with",
    "numbered",
    "several_threads",
]
