"""Tasks on several processes, with a pool that does what it is told: what dies, what is tried again, and in which order."""

from __future__ import annotations

import os
import queue
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, TypeVar

import pytest

from truepose.errors import InputError
from truepose.pool import Cluster, Pool, check_cluster, cluster, each, end_with, numbered, several_threads
from truepose.version import VERSION

T = TypeVar("T")
R = TypeVar("R")


class Told(Pool):
    """Three at once. A task ``dies`` beside another, or ``kills`` its process also alone; what comes after it is lost."""

    def __init__(self, dies: set[int], kills: set[int]) -> None:
        self.dies, self.kills = dies, kills
        self.asked = list[tuple[list[int], int]]()

    @property
    def workers(self) -> int:
        return 3

    def results(
        self, work: Callable[[T], R], tasks: Mapping[int, T], at_once: int
    ) -> Iterator[tuple[int, R | None]]:
        assert len(tasks) == len(list(tasks))
        self.asked.append((list(tasks), at_once))
        for k in tasks:
            if k in self.kills or (at_once > 1 and k in self.dies):
                yield k, None
                return
            yield k, work(tasks[k])


def test_every_task_has_its_result() -> None:
    pool = Told(set(), set())
    assert list(numbered(lambda k: 10 * k, [5, 6, 7], pool)) == [(0, 50), (1, 60), (2, 70)]
    assert list(each(lambda k: 10 * k, [5, 6, 7], pool)) == [(5, 50), (6, 60), (7, 70)]
    assert pool.asked == [([0, 1, 2], 3)] * 2
    assert list(numbered(lambda k: k, list[int](), pool)) == []


def test_what_may_have_killed_a_process_is_tried_again_last_and_alone() -> None:
    """What a dead process took with it is begun again at once; who dies alone, too, is given up."""
    pool = Told({1}, {2})
    assert list(each(lambda k: 10 * k, [5, 6, 7, 8], pool)) == [(5, 50), (8, 80), (6, 60), (7, None)]
    assert pool.asked == [([0, 1, 2, 3], 3), ([2, 3], 3), ([3], 3), ([1], 1), ([2], 1)]


def test_a_worker_ends_when_another_is_its_parent(monkeypatch: pytest.MonkeyPatch) -> None:
    ended, parents = queue.Queue[int](), iter([7, 7, 1])
    monkeypatch.setattr("truepose.pool.WATCHED", 0.01)
    monkeypatch.setattr(os, "getppid", lambda: next(parents))
    monkeypatch.setattr(os, "_exit", ended.put)
    end_with(7)
    assert ended.get(timeout=5.0) == 1
    assert next(parents, None) is None


class Client:
    """A cluster's client, as far as it is asked."""

    def __init__(self, threads: Mapping[str, int], states: Mapping[str, Any] | None = None) -> None:
        self.threads, self.states = threads, states

    def nthreads(self) -> Mapping[str, int]:
        return self.threads

    def run(self, _: object) -> Mapping[str, Any]:
        if self.states is None:
            raise ModuleNotFoundError("No module named 'truepose'")
        return self.states


@pytest.mark.parametrize(("threads", "workers"), [({}, 1), ({"a": 1}, 1), ({"a": 2, "b": 3}, 5)])
def test_a_cluster_works_with_all_threads_there_are(threads: dict[str, int], workers: int) -> None:
    assert Cluster(Client(threads)).workers == workers


STATES: dict[str, tuple[Mapping[str, Any] | None, str]] = {
    "another version": (
        {"tcp://a": (VERSION, ""), "tcp://b": ("0.1", "")},
        f"found truepose 0.1 on tcp://b, expected {VERSION} on all",
    ),
    "threads": (
        {"tcp://a": (VERSION, "OMP_NUM_THREADS=4")},
        "found OMP_NUM_THREADS=4 on tcp://a, expected OMP_NUM_THREADS=1",
    ),
    "nothing": (None, f"found a worker without truepose {VERSION}: No module named 'truepose'"),
    "alike": ({"tcp://a": (VERSION, ""), "tcp://b": (VERSION, "")}, ""),
}


@pytest.mark.parametrize("case", STATES)
def test_workers_of_a_cluster_are_alike(case: str) -> None:
    states, wrong = STATES[case]
    client: Any = Client({"a": 1}, states)
    if wrong:
        with pytest.raises(InputError) as refused:
            check_cluster(client, "--dask a")
        assert str(refused.value).startswith(f"--dask a: {wrong}")
    else:
        assert check_cluster(client, "--dask a").client is client


@pytest.mark.parametrize(
    ("environment", "wrong"),
    [
        ({"OMP_NUM_THREADS": "1"}, ""),
        ({}, "no OMP_NUM_THREADS"),
        ({"OMP_NUM_THREADS": ""}, "no OMP_NUM_THREADS"),
        ({"OMP_NUM_THREADS": "4"}, "OMP_NUM_THREADS=4"),
        ({"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}, ""),
        ({"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "2"}, "OPENBLAS_NUM_THREADS=2"),
        ({"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "8"}, "MKL_NUM_THREADS=8"),
        ({"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "", "MKL_NUM_THREADS": ""}, ""),
        ({"MKL_NUM_THREADS": "1"}, "no OMP_NUM_THREADS"),
    ],
)
def test_linear_algebra_has_one_thread_where_its_first_variable_says_so(
    environment: dict[str, str], wrong: str
) -> None:
    """And no other one says otherwise: a library reads its own before it reads that of all."""
    assert several_threads(environment) == wrong


class LostError(Exception):
    """What Dask raises for a task whose worker died."""


@dataclass(frozen=True, eq=False)
class Future:
    """A task that was sent."""

    result: Callable[[], object]


class Scheduler:
    """As much of Dask as a pool asks for: tasks wait until somebody looks for what is done, the latest first."""

    def __init__(self, address: str, timeout: float = 0.0, kills: frozenset[int] = frozenset()) -> None:
        if address == "tcp://nobody":
            raise OSError("timed out")
        self.address, self.timeout, self.kills = address, timeout, kills
        self.open, self.waiting, self.most, self.keys = 0, deque[Any](), 0, list[str]()

    def __enter__(self) -> None:
        self.open += 1

    def __exit__(self, *_: object) -> None:
        self.open -= 1

    def nthreads(self) -> dict[str, int]:
        return {"a": 1, "b": 1}

    def run(self, state: Callable[[], object]) -> dict[str, object]:
        return {"tcp://a": state()}

    def submit(self, numbered: Any, work: Any, task: Any, number: int, *, pure: bool, key: str) -> Any:
        assert not pure  # the same task may be asked for twice

        def result() -> object:
            if number in self.kills:
                raise LostError
            return numbered(work, task, number)

        self.keys.append(key)
        return Future(result)


class Coming:
    """Futures as they are done."""

    def __init__(self, futures: Mapping[Any, int]) -> None:
        self.waiting = deque(futures)
        self.most = len(self.waiting)

    def add(self, future: Any) -> None:
        self.waiting.append(future)
        self.most = max(self.most, len(self.waiting))

    def __iter__(self) -> Iterator[Any]:
        while self.waiting:
            yield self.waiting.pop()


@pytest.fixture
def dask(monkeypatch: pytest.MonkeyPatch) -> list[Coming]:
    """Dask's modules in its place; what has been waited for."""
    waited: list[Coming] = []

    def as_completed(futures: Mapping[Any, int]) -> Coming:
        waited.append(Coming(futures))
        return waited[-1]

    config = SimpleNamespace(set=lambda _: nullcontext())
    for name, module in {
        "dask": SimpleNamespace(config=config),
        "distributed": SimpleNamespace(Client=Scheduler, as_completed=as_completed),
        "distributed.scheduler": SimpleNamespace(KilledWorker=LostError),
    }.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    return waited


@pytest.mark.parametrize(("at_once", "most"), [(1, 1), (3, 3), (9, 4)])
def test_a_cluster_has_two_tasks_for_each_thread_on_their_way(
    at_once: int, most: int, dask: list[Coming]
) -> None:
    """Or as many as may be at once; each task is sent once, and one that killed its worker has no result."""
    client = Scheduler("tcp://a", kills=frozenset({2}))
    tasks = {k: 10 * k for k in range(6)}
    found = list(Cluster(client).results(lambda task: task + 1, tasks, at_once))
    assert sorted(found) == [(k, None if k == 2 else 10 * k + 1) for k in range(6)]
    assert len(set(client.keys)) == 6
    (coming,) = dask
    assert coming.most == most
    assert list(Cluster(client).results(lambda task: task, {}, at_once)) == []


def test_a_cluster_is_looked_at_before_it_is_used(
    dask: list[Coming], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not dask
    with cluster("tcp://a") as found:
        assert (found.client.address, found.client.open, found.client.timeout) == ("tcp://a", 1, 30.0)
        assert found.workers == 2
    assert found.client.open == 0
    with pytest.raises(InputError, match=r"^--dask tcp://nobody: found no scheduler there: timed out$"):
        cluster("tcp://nobody").__enter__()
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    with (
        pytest.raises(InputError, match="--dask tcp://a: found OMP_NUM_THREADS=3 on tcp://a"),
        cluster("tcp://a"),
    ):
        pass
