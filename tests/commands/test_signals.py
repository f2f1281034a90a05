"""When a signal is heard, with a clock that is set by hand: at once, once for two, at the end of what may not be broken."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from truepose import faults
from truepose.stopping import ONCE, Stopped, Stopping, stopping

pytestmark = pytest.mark.skipif(os.name == "nt", reason="no such signals")
BOTH = (signal.SIGINT, signal.SIGTERM)
USUAL: dict[signal.Signals, Any] = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}


@pytest.fixture
def own(monkeypatch: pytest.MonkeyPatch) -> Iterator[Stopping]:
    """One that listens, of this test alone; afterwards all is as before."""
    before = {number: signal.getsignal(number) for number in BOTH}
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    for number, usual in USUAL.items():
        signal.signal(number, usual)
    made = Stopping()
    made.listen()
    yield made
    for number, handler in before.items():
        signal.signal(number, handler)


def came(number: int = signal.SIGINT) -> bool:
    """Whether a signal sent now breaks off what is done."""
    try:
        signal.raise_signal(number)
        time.sleep(0)
    except Stopped:
        return True
    return False


def test_before_it_listens_nothing_has_come() -> None:
    fresh = Stopping()
    assert (fresh.listens, fresh.number, fresh.told()) == (False, 0, "stopped; nothing was written")
    assert fresh.code == 130  # of a Ctrl-C that Python itself heard


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_stops_and_gives_the_code(own: Stopping, number: int, code: int) -> None:
    assert own.listens and came(number)
    assert (own.number, own.code) == (number, code)


@pytest.mark.parametrize(("later", "again"), [(0.0, False), (0.9, False), (1.1, True)])
def test_signals_within_a_second_are_one(
    own: Stopping, later: float, again: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ONCE == 1.0
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now)
    assert came()
    monkeypatch.setattr(time, "monotonic", lambda: now + later)
    assert came() is again


def test_what_may_not_be_broken_is_ended_first(own: Stopping) -> None:
    """Of blocks in blocks the outermost; and a signal is heard once only."""
    done = list[str]()
    with pytest.raises(Stopped), own.undisturbed():
        with own.undisturbed():
            assert not came()
            done.append("inner")
        done.append("outer")
    assert done == ["inner", "outer"]
    with own.undisturbed():
        done.append("another")
    assert done[-1] == "another"


def test_at_the_end_signals_are_the_systems_again(own: Stopping) -> None:
    """But for one that somebody else has taken meanwhile."""

    def theirs(*_: object) -> None:
        pass

    signal.signal(signal.SIGTERM, theirs)
    own.over()
    assert signal.getsignal(signal.SIGINT) == signal.SIG_DFL
    assert signal.getsignal(signal.SIGTERM) is theirs


def test_what_is_turned_off_or_taken_stays_so(own: Stopping) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    own.written.append("old.csv")
    own.listen()
    assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    assert own.told() == "stopped; nothing was written"


def test_what_was_lost_in_a_callback_comes_again(own: Stopping) -> None:
    assert came()
    begun = time.monotonic()
    sys.unraisablehook(SimpleNamespace(exc_type=Stopped))
    with pytest.raises(Stopped):
        time.sleep(5.0)
    assert time.monotonic() - begun < 1.0


def test_what_else_is_lost_is_told_unless_the_end_has_begun(
    own: Stopping, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = list[object]()
    monkeypatch.setattr(sys, "__unraisablehook__", told.append)
    lost = SimpleNamespace(exc_type=ValueError)
    sys.unraisablehook(lost)
    sys.unraisablehook(SimpleNamespace(exc_type=KeyboardInterrupt))
    assert told[0] is lost and len(told) == 2
    assert came()
    sys.unraisablehook(lost)
    assert len(told) == 2


def test_what_stands_is_told(own: Stopping) -> None:
    own.written += ["a.csv", "b.csv"]
    assert own.told() == "stopped; written before: a.csv, b.csv"
    own.left = "the same command goes on"
    assert own.told() == "stopped: the same command goes on"


def test_a_program_hears_while_it_runs_and_not_after(
    own: Stopping, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With its exit code and its words, whatever else came of the interruption."""
    own.over()
    for number, usual in USUAL.items():
        signal.signal(number, usual)
    for name in ("number", "listens", "left"):  # put back afterwards
        monkeypatch.setattr(stopping, name, getattr(stopping, name))

    def lost() -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt:
            raise ValueError("made of an interruption by compiled code") from None

    with pytest.raises(SystemExit) as end:
        faults.main(lost)
    assert end.value.code == 143
    assert capsys.readouterr().err == "error: stopped; nothing was written\n"
    assert signal.getsignal(signal.SIGTERM) == signal.getsignal(signal.SIGINT) == signal.SIG_DFL
