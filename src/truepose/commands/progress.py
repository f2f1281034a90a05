"""What a command shows while it works: a bar on a terminal, elsewhere a line every ten seconds.

Nothing appears in the first two seconds; standard output stays free.
"""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator

import typer

DELAY, EVERY = 2.0, 10.0
"""Seconds of work before anything is shown, and between two lines where output is no terminal."""
Say = Callable[[str], None]
Count = Callable[[int, int, str], None]


@contextlib.contextmanager
def progress(label: str) -> Iterator[Say]:
    """Show on standard error what goes on; yield a function that takes it."""
    with _shown(label) as show:
        yield lambda text: show(0, 0, text)


@contextlib.contextmanager
def counted(label: str) -> Iterator[Count]:
    """Show steps whose number is known; yield a function that takes how many are done, of how many, and the last one."""
    with _shown(label) as show:
        yield lambda done, total, name: show(done, total, f"{label}: {name}")


def _shown(label: str) -> contextlib.AbstractContextManager[Count]:
    return _bar(label) if sys.stderr.isatty() else _lines(label)


@contextlib.contextmanager
def _lines(label: str) -> Iterator[Count]:
    text, begun, over = label, time.monotonic(), threading.Event()

    def watch() -> None:
        wait = DELAY
        while not over.wait(wait):
            wait = EVERY
            with contextlib.suppress(OSError):  # nobody looks
                typer.echo(f"{text} ({time.monotonic() - begun:.0f} s)", err=True)

    def show(done: int, total: int, now: str) -> None:
        nonlocal text
        text = f"{now}, {done} of {total}" if total else now

    watching = threading.Thread(target=watch, daemon=True)
    watching.start()
    try:
        yield show
    finally:
        over.set()
        watching.join()


@contextlib.contextmanager
def _bar(label: str) -> Iterator[Count]:
    from rich.console import Console
    from rich.progress import Progress, TimeElapsedColumn

    columns = (*Progress.get_default_columns(), TimeElapsedColumn())
    display = Progress(*columns, console=Console(stderr=True), transient=True)
    task = display.add_task(label, total=None)
    timer = threading.Timer(DELAY, display.start)
    timer.daemon = True
    timer.start()
    try:
        yield lambda done, total, text: display.update(
            task, description=text, completed=done, total=total or None
        )
    finally:
        timer.cancel()
        timer.join()
        display.stop()
