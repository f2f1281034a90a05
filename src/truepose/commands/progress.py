"""What a command shows while it works: a bar on a terminal, elsewhere a line a stage and one every ten seconds.

Nothing appears in the first two seconds, nor with ``--quiet``; standard output stays free. The time left is shown where it
follows from what is done within a factor of two: after stages that took what they cost beside each other, or counted steps.
"""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from rich.progress import Progress

DELAY, EVERY = 2.0, 10.0
"""Seconds of work before anything is shown, and longest silence where output is no terminal."""
FEWEST, TELLING = 2, 0.02
"""Stages, and share of counted steps, that must be done before the time left is told."""
TRUST = 1.3
"""Factor by which a stage or a step may take longer or shorter than those before it; one that takes longer tells nothing."""
WITHIN = 2.0
"""Factor by which the time left that is shown may be wrong."""
Say = Callable[[str], None]
Stages = Sequence[tuple[str, float]]
"""Stages by how what is said of them begins, with their relative cost."""
_quiet: ContextVar[bool] = ContextVar("quiet", default=False)


def quiet() -> bool:
    """Whether the running command was asked to say nothing but errors."""
    return _quiet.get()


@contextlib.contextmanager
def quietly(wanted: bool) -> Iterator[None]:
    """Let commands inside the block be quiet."""
    token = _quiet.set(wanted)
    try:
        yield
    finally:
        _quiet.reset(token)


class Course:
    """Where a work stands: its stage, the time it took and, where that can be said, the time left."""

    def __init__(self, label: str, stages: Stages = (), clock: Callable[[], float] = time.monotonic) -> None:
        self.text, self._stages, self._clock = label, stages, clock
        self._begin = self._since = clock()
        self._at = -1
        self._counted: tuple[int, int] | None = None
        self._rates = list[float]()

    def say(self, text: str) -> None:
        """Note what goes on; a stage begins where the text is the beginning of one."""
        self.text = text
        found = [k for k, (name, _) in enumerate(self._stages) if text.startswith(name)]
        best = max(found, key=lambda k: len(self._stages[k][0]), default=self._at)
        if best > self._at:
            if self._at >= 0:
                cost = sum(cost for _, cost in self._stages[self._at : best])
                self._rates.append((self._clock() - self._since) / cost)
            self._at, self._since = best, self._clock()

    def count(self, done: int, total: int) -> None:
        """Note how many of a known number of steps are done."""
        self._counted, self._since = (done, total), self._clock()

    @property
    def elapsed(self) -> float:
        """Seconds since the beginning."""
        return self._clock() - self._begin

    @property
    def share(self) -> float | None:
        """Share of the work that is done; None where its stages are not known."""
        if self._counted is not None:
            return self._counted[0] / max(self._counted[1], 1)
        costs = [cost for _, cost in self._stages]
        return sum(costs[: max(self._at, 0)]) / sum(costs) if costs else None

    @property
    def left(self) -> float | None:
        """Seconds left; None where what is done does not tell them within ``WITHIN``, and where less than one is left."""
        low, high = self._least_and_most()
        rest = float((low * high) ** 0.5)
        return rest if high <= WITHIN**2 * low and rest >= 1.0 else None

    def _least_and_most(self) -> tuple[float, float]:
        """Seconds that may be left, if the rest goes about as what is done; (0, infinity) where nothing follows from that."""
        late = self._clock() - self._since
        if self._counted is not None:
            done, total = self._counted
            known = done > 0 and done >= TELLING * total
            rates, costs = [(self._since - self._begin) / max(done, 1)], [1.0] * (total - done)
        else:
            known = len(self._rates) >= FEWEST
            rates, costs = self._rates, [cost for _, cost in self._stages[self._at :]]
        if not known or not costs or late > TRUST * max(rates) * costs[0]:
            return 0.0, float("inf")
        low, high = min(rates) / TRUST, max(rates) * TRUST
        later = sum(costs[1:])
        return later * low + max(costs[0] * low - late, 0.0), later * high + costs[0] * high - late

    @property
    def words(self) -> str:
        """``weighing 758 explanations (stage 2 of 4, 12 s)``."""
        stage = f"stage {self._at + 1} of {len(self._stages)}, " if self._at >= 0 else ""
        steps = f"{self._counted[0]} of {self._counted[1]}, " if self._counted else ""
        return f"{self.text} ({steps}{stage}{lasting(self.elapsed)}{self.left_words})"

    @property
    def left_words(self) -> str:
        """``, about 20 s left``; nothing where that is not known."""
        return "" if self.left is None else f", about {lasting(self.left)} left"


def lasting(seconds: float) -> str:
    """``12 s``, ``3 min``, ``2.5 h``."""
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class Lines:
    """A course in lines: each stage that begins after the first two seconds, and whatever goes on every ten."""

    def __init__(self, course: Course, write: Say) -> None:
        self._course, self._write = course, write
        self._due, self._lock = DELAY, threading.Lock()

    def say(self, text: str) -> None:
        """Note what goes on, and tell it if the work is long."""
        self._course.say(text)
        if self._course.elapsed >= DELAY:
            self._tell()

    def tick(self) -> None:
        """Tell what goes on if nothing was told for long enough."""
        if self._course.elapsed >= self._due:
            self._tell()

    def _tell(self) -> None:
        with self._lock:
            self._due = self._course.elapsed + EVERY
            self._write(self._course.words)


@contextlib.contextmanager
def progress(label: str, stages: Stages = ()) -> Iterator[Say]:
    """Show what goes on on standard error; yields how to say it. ``stages``: of known relative cost, in their order."""
    course = Course(label, stages)
    with _shown(course) as say:
        yield say


@contextlib.contextmanager
def counted(label: str) -> Iterator[Callable[[int, int, str], None]]:
    """The same of steps whose number is known; yields how to say how many are done, of how many, and what the last was."""
    course = Course(label)
    with _shown(course) as say:

        def hear(done: int, total: int, name: str) -> None:
            course.count(done, total)
            say(f"{label}: {name}")

        yield hear


@contextlib.contextmanager
def _shown(course: Course) -> Iterator[Say]:
    if quiet():
        yield lambda _: None
    elif sys.stderr.isatty():
        with _bar(course) as say:
            yield say
    else:
        with _lines(course) as say:
            yield say


@contextlib.contextmanager
def _lines(course: Course) -> Iterator[Say]:
    def write(text: str) -> None:
        with contextlib.suppress(OSError):  # nobody looks
            typer.echo(text, err=True)

    lines, over = Lines(course, write), threading.Event()

    def watch() -> None:
        while not over.wait(0.5):
            lines.tick()

    watching = threading.Thread(target=watch, daemon=True)
    watching.start()
    try:
        yield lines.say
    finally:
        over.set()
        watching.join()


@contextlib.contextmanager
def _bar(course: Course) -> Iterator[Say]:
    display = _display(course)
    task = display.add_task(course.text, total=None if course.share is None else 1.0)
    timer = threading.Timer(DELAY, display.start)
    timer.daemon = True
    timer.start()

    def say(text: str) -> None:
        course.say(text)
        share = course.share
        if share is None:
            display.update(task, description=text)
        else:
            display.update(task, description=text, total=1.0, completed=share)

    try:
        yield say
    finally:
        timer.cancel()
        timer.join()
        display.stop()


def _display(course: Course) -> Progress:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        ProgressColumn,
        SpinnerColumn,
        Task,
        TextColumn,
        TimeElapsedColumn,
    )
    from rich.text import Text

    class Left(ProgressColumn):
        """What is left, as long as it can be said."""

        def render(self, task: Task) -> Text:
            return Text(course.left_words.removeprefix(", "))

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), Left())
    return Progress(*columns, console=Console(stderr=True), transient=True)


__all__ = ["Course", "Lines", "Say", "Stages", "counted", "lasting", "progress", "quiet", "quietly"]
