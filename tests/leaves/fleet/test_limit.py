"""A limit of time: nothing happens before it, and nothing that mends faults holds it up."""

from __future__ import annotations

import threading
import time

import pytest

from truepose.identification.leaves.fleet.limit import OverdueError, within


def test_work_that_ends_in_time_is_left_alone() -> None:
    for minutes in (None, 10.0):
        with within(minutes):
            done = sum(range(1000))
        assert done == 499500
    with pytest.raises(KeyError), within(10.0):
        raise KeyError("its own fault")


def test_work_that_takes_longer_is_ended() -> None:
    """After a tenth of a second, also where the first raise is swallowed by what mends all faults."""
    began, swallowed = time.monotonic(), 0
    with pytest.raises(OverdueError), within(0.1 / 60.0):
        while time.monotonic() - began < 300.0:
            try:
                while time.monotonic() - began < 300.0:
                    time.sleep(0.001)
            except Exception:
                swallowed += 1
            except BaseException:
                swallowed += 1
                if swallowed > 1:
                    raise
    assert swallowed == 2
    assert time.monotonic() - began >= 0.1
    time.sleep(0.3)  # nothing comes behind it


def test_a_limit_is_over_with_its_block() -> None:
    before = set(threading.enumerate())
    with within(10.0):
        watching = set(threading.enumerate()) - before
    assert watching
    for thread in watching:
        thread.join(300.0)
        assert not thread.is_alive()
