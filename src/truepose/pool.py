"""Tasks on several processes: by joblib on the cores of this computer, by Dask on a cluster's.

A process that dies takes nothing with it but its own task. Tasks that may have been at work in it are tried again after all
others, one at a time; one whose process dies then, too, has no result.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Protocol, TypeVar

from joblib.externals.loky import ProcessPoolExecutor

from truepose.errors import InputError
from truepose.version import VERSION

if TYPE_CHECKING:
    from distributed import Client

T = TypeVar("T")
R = TypeVar("R")
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables of libraries of linear algebra; the last two are read before the first."""


class Pool(Protocol):
    """Processes that work tasks, no more than ``at_once``; ``dead`` is raised for a task that may have killed its process."""

    @property
    def at_once(self) -> int: ...
    @property
    def dead(self) -> type[Exception]: ...
    def executor(self) -> contextlib.AbstractContextManager[Executor]:
        """Return an executor for a block; what is at work when the block fails is ended."""


@dataclass(frozen=True)
class Cores:
    """Processes on this computer, each with one thread of linear algebra. All end when one dies."""

    at_once: int
    dead = BrokenProcessPool

    @contextlib.contextmanager
    def executor(self) -> Iterator[Executor]:
        """Yield an executor of joblib's kind, but not the one that its own users share."""
        executor = ProcessPoolExecutor(self.at_once, env=dict.fromkeys(THREADS, "1"))
        try:
            yield executor
        except BaseException:
            executor.shutdown(kill_workers=True)
            raise
        executor.shutdown()


@dataclass(frozen=True)
class Cluster:
    """Workers of Dask. Not by joblib's backend, which never hears of a task whose worker has died (joblib 1.6.0)."""

    client: Client

    @property
    def at_once(self) -> int:
        """One task for each thread: the fewer are sent, the fewer are lost with a worker."""
        return max(int(sum(self.client.nthreads().values())), 1)

    @property
    def dead(self) -> type[Exception]:
        """Error of Dask for a task whose workers died."""
        from distributed import KilledWorker

        return KilledWorker  # type: ignore[no-any-return]

    @contextlib.contextmanager
    def executor(self) -> Iterator[Executor]:
        """Yield Dask's executor."""
        import dask

        executor = self.client.get_executor(pure=False)
        try:  # tasks are large for a reason
            with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"}):
                yield executor
        finally:
            executor.shutdown(wait=False)


def numbered(work: Callable[[T], R], tasks: Sequence[T], pool: Pool) -> Iterator[tuple[int, R | None]]:
    """Yield the number of every task with its result, as they come; None for one whose process died twice.

    A task is asked for only when it is begun.
    """
    left, suspects = dict.fromkeys(range(len(tasks))), list[int]()
    while left:
        for k, result in _results(work, tasks, tuple(left), pool, pool.at_once):
            del left[k]
            if result is None:
                suspects.append(k)
            else:
                yield k, result
    for k in suspects:
        yield from _results(work, tasks, (k,), pool, 1)


def _results(
    work: Callable[[T], R], tasks: Sequence[T], numbers: Sequence[int], pool: Pool, at_once: int
) -> Iterator[tuple[int, R | None]]:
    """Yield the numbers of tasks with their results, as they come; None where a process died.

    A task whose number is missing at the end was not begun.
    """
    waiting, sent = iter(numbers), dict[Future[R], int]()
    with pool.executor() as executor:
        while True:
            with contextlib.suppress(pool.dead):  # nothing more is begun then
                for k in islice(waiting, at_once - len(sent)):
                    sent[executor.submit(work, tasks[k])] = k
            if not sent:
                return
            for future in wait(sent, return_when=FIRST_COMPLETED).done:
                k = sent.pop(future)
                try:
                    yield k, future.result()
                except pool.dead:
                    yield k, None


@contextlib.contextmanager
def cluster(address: str) -> Iterator[Cluster]:
    """Yield the Dask cluster whose scheduler has this address. Raises InputError where there is none with this truepose."""
    try:
        from distributed import Client

        client = Client(address, timeout=30.0)
    except ImportError:
        raise InputError(
            "--dask: Dask is not installed, expected the extra dask: pip install 'truepose[dask]'"
        ) from None
    except (OSError, ValueError) as exc:
        raise InputError(f"--dask {address}: found no scheduler there: {exc}") from None
    with client:
        yield check_cluster(client, f"--dask {address}")


def check_cluster(client: Client, where: str) -> Cluster:
    """Return the cluster of a client. Raises InputError for workers of another version, and of sums rounded otherwise."""
    try:
        states = client.run(_state)
    except Exception as exc:  # whatever a worker raises that has no truepose
        raise InputError(f"{where}: found a worker without truepose {VERSION}: {exc}") from None
    for worker, (version, threads) in states.items():
        if version != VERSION:
            raise InputError(f"{where}: found truepose {version} on {worker}, expected {VERSION} on all")
        if threads:
            raise InputError(
                f"{where}: found {threads} on {worker}, expected OMP_NUM_THREADS=1: with more threads of linear"
                " algebra results differ in their last digits. A worker that has a nanny starts so"
            )
    return Cluster(client)


def _state() -> tuple[str, str]:
    return VERSION, several_threads(os.environ)


def several_threads(environment: Mapping[str, str]) -> str:
    """Return the variable that lets linear algebra have more than one thread; an empty text where none does."""
    first, *others = ((name, environment.get(name, "")) for name in THREADS)
    wrong = [first] if first[1] != "1" else [one for one in others if one[1] not in ("", "1")]
    return "" if not wrong else "=".join(wrong[0]) if wrong[0][1] else f"no {wrong[0][0]}"
