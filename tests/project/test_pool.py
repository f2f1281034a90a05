"""Tasks on several processes, with a pool that does what it is told: what dies, what is tried again, and in which order."""

from __future__ import annotations

import os
import queue
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

import pytest

from truepose.errors import InputError
from truepose.pool import Cluster, Pool, each, end_with, numbered, present, rows_on
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
def test_workers_of_a_cluster_are_alike(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where joblib was told of one; on cores there is none."""
    with rows_on(""):
        assert present() is None
    states, wrong = STATES[case]
    backend = type("Backend", (), {"client": Client({"a": 1}, states)})()
    monkeypatch.setattr("truepose.pool.get_active_backend", lambda: (backend, 1))
    if wrong:
        with pytest.raises(InputError) as refused:
            present()
        assert str(refused.value).startswith(f"joblib's backend 'dask': {wrong}")
    else:
        found = present()
        assert found is not None and found.client is backend.client
