"""A limit of time: nothing happens before it, and nothing that mends faults holds it up."""

from __future__ import annotations

import time

import pytest

from truepose.identification.leaves.fleet.work import OverdueError, within


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
        while time.monotonic() - began < 20.0:
            try:
                while time.monotonic() - began < 20.0:
                    time.sleep(0.001)
            except Exception:
                swallowed += 1
            except BaseException:
                swallowed += 1
                if swallowed > 1:
                    raise
    assert swallowed == 2
    assert 0.1 <= time.monotonic() - began < 19.0
    time.sleep(0.3)  # nothing comes behind it


def test_a_limit_is_over_with_its_block() -> None:
    with within(0.05 / 60.0):
        pass
    time.sleep(0.2)
