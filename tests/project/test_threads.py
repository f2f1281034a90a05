"""Laws of work in threads: what comes out does not depend on how many there are."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truepose.errors import InputError
from truepose.threads import VARIABLE, Cached, all_done, in_order, one_thread, processors


@given(st.lists(st.integers(), max_size=30), st.integers(1, 5))
def test_results_come_in_the_order_of_items(items: list[int], threads: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, str(threads))
        assert list(in_order(lambda k: 2 * k, items)) == [2 * k for k in items]
        done = np.zeros(len(items), dtype=int)
        all_done(lambda k: done.__setitem__(k, done[k] + 1), range(len(items)))
    assert np.all(done == 1)


def test_no_more_is_worked_out_ahead_than_there_are_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "2")
    begun, lock = list[int](), threading.Lock()

    def work(k: int) -> int:
        with lock:
            begun.append(k)
        return k

    results = in_order(work, range(50))
    next(results)
    time.sleep(0.05)  # would be enough for all of them
    assert len(begun) <= 4
    assert list(results) == list(range(1, 50))


def test_what_fails_in_a_thread_fails_where_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "3")
    with pytest.raises(ZeroDivisionError):
        list(in_order(lambda k: 1 // k, [2, 1, 0, 3]))


@pytest.mark.parametrize("asked", ["0", "-1", "two", "1.5", ""])
def test_a_number_of_threads_that_is_none(asked: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, asked)
    with pytest.raises(InputError, match=f"{VARIABLE}: found '{asked}'"):
        processors()


@pytest.mark.parametrize(("cores", "usual"), [(1, 1), (4, 4), (8, 8), (64, 8)])
def test_there_are_as_many_threads_as_processors_and_no_crowd(
    cores: int, usual: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More where somebody asks for them, one where whole pieces of work run beside each other."""
    monkeypatch.setattr("truepose.threads.cores", lambda: cores)
    monkeypatch.delenv(VARIABLE, raising=False)
    assert processors() == usual
    with one_thread():
        assert processors() == 1
    assert processors() == usual
    monkeypatch.setenv(VARIABLE, "16")
    assert processors() == 16
    with one_thread():
        assert processors() == 1


def test_two_threads_work_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each waits until the other is there, too."""
    monkeypatch.setenv(VARIABLE, "2")
    both = threading.Barrier(2, timeout=300.0)
    assert sorted(in_order(lambda _: both.wait(), range(2))) == [0, 1]
    done = list[int]()

    def met(k: int) -> None:
        both.wait()
        done.append(k)

    all_done(met, range(2))
    assert sorted(done) == [0, 1]


class Waiting:
    """Each value is worked out while the other one is."""

    def __init__(self, barrier: threading.Barrier) -> None:
        self.barrier, self.times = barrier, 0

    @Cached
    def value(self) -> int:
        """Worked out once."""
        self.times += 1
        self.barrier.wait(timeout=300.0)
        return self.times


def test_values_of_two_objects_are_worked_out_beside_each_other_and_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(VARIABLE, "2")
    both = [Waiting(barrier) for barrier in [threading.Barrier(2)] * 2]
    assert list(in_order(lambda one: one.value, both)) == [1, 1]
    assert [one.value for one in both] == [1, 1] and [one.times for one in both] == [1, 1]
    assert Waiting.value.__doc__ == "Worked out once."
