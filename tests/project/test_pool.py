"""Tasks on several processes: what dies, what is tried again, and in which order; and what a cluster must be."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest

from truepose.errors import InputError
from truepose.pool import Cluster, Cores, check_cluster, cluster, numbered, several_threads
from truepose.version import VERSION


class DeadError(Exception):
    """What a pool raises for a task whose process died."""


class Told(Executor):
    """A pool of three. A task ``dies`` behind another, or ``kills`` its process also alone; nothing is begun afterwards."""

    at_once, dead = 3, DeadError

    def __init__(self, dies: set[int], kills: set[int]) -> None:
        self.dies, self.kills = dies, kills
        self.asked = list[list[int]]()
        self.broken = False

    @contextmanager
    def executor(self) -> Iterator[Executor]:
        self.asked.append([])
        self.broken = False
        yield self

    def submit(self, work: Callable[..., Any], /, *arguments: Any, **_: Any) -> Future[Any]:
        if self.broken:
            raise DeadError
        (task,) = arguments
        self.broken = task in self.kills or (task in self.dies and bool(self.asked[-1]))
        self.asked[-1].append(task)
        future = Future[Any]()
        if self.broken:
            future.set_exception(DeadError())
        else:
            future.set_result(work(task))
        return future


def test_every_task_has_its_result() -> None:
    pool = Told(set(), set())
    found = dict(numbered(lambda k: 10 * k, [5, 6, 7, 4, 9, 8], pool))
    assert found == {0: 50, 1: 60, 2: 70, 3: 40, 4: 90, 5: 80}
    assert pool.asked == [[5, 6, 7, 4, 9, 8]]
    assert list(numbered(lambda k: k, list[int](), pool)) == []


def test_a_task_is_asked_for_only_when_it_is_begun() -> None:
    asked = list[int]()

    class Tasks(list[int]):
        def __getitem__(self, k: Any) -> Any:
            asked.append(k)
            return super().__getitem__(k)

    results = numbered(lambda k: k, Tasks(range(9)), Told(set(), set()))
    assert next(results)[0] in (0, 1, 2) and asked == [0, 1, 2]
    assert len(list(results)) == 8 and asked == list(range(9))


def test_what_may_have_killed_a_process_is_tried_again_last_and_alone() -> None:
    """What was not begun is begun at once; who dies alone, too, is given up."""
    pool = Told({6}, {7})
    found = list(numbered(lambda k: 10 * k, [4, 6, 5, 7, 3, 2], pool))
    assert dict(found) == {0: 40, 1: 60, 2: 50, 3: None, 4: 30, 5: 20}
    assert [k for k, _ in found][-2:] == [1, 3]
    assert pool.asked == [[4, 6], [5, 7], [3, 2], [6], [7]]


def die(task: int) -> int:
    """Kill the process of one task."""
    if task == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


@pytest.mark.skipif(os.name == "nt", reason="no SIGKILL")
@pytest.mark.parametrize("processes", [1, 2])
def test_a_process_that_dies_takes_nothing_with_it_but_its_task(processes: int) -> None:
    found = dict(numbered(die, range(4), Cores(processes)))
    assert found[1] is None and len(found) == 4
    assert all(found[k] not in (None, os.getpid()) for k in (0, 2, 3))


class Client:
    """A cluster's client, as far as it is asked; without ``states`` its workers have no truepose."""

    def __init__(self, threads: Mapping[str, int], states: Mapping[str, Any] | None = None) -> None:
        self.threads, self.states, self.open = threads, states, 0

    def __enter__(self) -> None:
        self.open += 1

    def __exit__(self, *_: object) -> None:
        self.open -= 1

    def nthreads(self) -> Mapping[str, int]:
        return self.threads

    def run(self, state: Callable[[], object]) -> Mapping[str, Any]:
        if self.states is None:
            raise ModuleNotFoundError("No module named 'truepose'")
        return self.states or {"tcp://a": state()}


@pytest.mark.parametrize(("threads", "at_once"), [({}, 1), ({"a": 1}, 1), ({"a": 2, "b": 3}, 5)])
def test_a_cluster_has_a_task_for_each_thread(threads: dict[str, int], at_once: int) -> None:
    assert Cluster(Client(threads)).at_once == at_once


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


class Scheduler(Client):
    """The client of two workers that are like this process."""

    def __init__(self, address: str, timeout: float = 0.0) -> None:
        if address == "tcp://nobody":
            raise OSError("timed out")
        super().__init__({"a": 1, "b": 1}, {})
        self.address, self.timeout = address, timeout


def test_a_cluster_is_looked_at_before_it_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=Scheduler))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    with cluster("tcp://a") as found:
        assert (found.client.address, found.client.open, found.client.timeout) == ("tcp://a", 1, 30.0)
        assert found.at_once == 2
    assert found.client.open == 0
    with pytest.raises(InputError, match=r"^--dask tcp://nobody: found no scheduler there: timed out$"):
        cluster("tcp://nobody").__enter__()
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    with (
        pytest.raises(InputError, match="--dask tcp://a: found OMP_NUM_THREADS=3 on tcp://a"),
        cluster("tcp://a"),
    ):
        pass
