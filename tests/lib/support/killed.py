"""Run as a script: publishes one result over another, killed before its first, second, third ... change on disk.

``python killed.py ROOM [nolinks] [here] [fresh]``: in ROOM/0, ROOM/1 ... a folder ``out`` with the old result and a
user's files is made, and a child process that publishes the new one is killed (SIGKILL) before so many changes.
The last folder is that of the child that ended by itself; how many there are is printed.
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

from truepose.files import atomic_directory

OLD = {"a.txt": "old a", "b.txt": "old b", "sub/c.txt": "old c", "linked.txt": "user's own, elsewhere"}
NEW = {"a.txt": "new a", "b.txt": "new b", "sub/c.txt": "new c", "linked.txt": "new", "more.txt": "new m"} | {
    "deep/new/d.txt": "new d"
}
OWN = {"kept.txt": "kept", "sub/own.txt": "kept too"}
ELSEWHERE = "elsewhere.txt"
CHANGES = {"open", *(f"os.{name}" for name in ("rename", "link", "symlink", "mkdir", "remove", "rmdir"))}


def fill(folder: Path, texts: dict[str, str]) -> None:
    """Write a result."""
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def before(room: Path) -> None:
    """The old result, and what belongs to the user."""
    room.mkdir()
    (room / ELSEWHERE).write_text(OLD["linked.txt"], encoding="utf-8")
    fill(room / "out", OWN | {name: text for name, text in OLD.items() if name != "linked.txt"})
    (room / "out" / "empty").mkdir()
    (room / "out" / "linked.txt").symlink_to(f"../{ELSEWHERE}")


def _no_links(*_: object, **__: object) -> None:
    raise PermissionError(1, "no links here")


def _publish(room: Path, spared: int, options: list[str]) -> None:
    left = spared

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal left
        reads = event == "open" and not (isinstance(arguments[1], str) and "w" in arguments[1])
        if event in CHANGES and not reads:
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            left -= 1

    if "nolinks" in options:
        os.symlink = _no_links
    if "here" in options:
        os.chdir(room / "out")
    sys.addaudithook(hook)
    with atomic_directory("." if "here" in options else room / "out") as partial:
        fill(partial, NEW)


def main(room: Path, options: list[str]) -> None:
    """Kill once later each time, until nothing is left to kill."""
    for spared in range(500):
        here = room / str(spared)
        if "fresh" in options:
            here.mkdir()
        else:
            before(here)
        child = os.fork()
        if child == 0:
            _publish(here, spared, options)
            os._exit(0)
        status = os.waitpid(child, 0)[1]
        if not os.WIFSIGNALED(status):
            sys.stdout.write(f"{spared + 1}\n")
            sys.exit(status != 0)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
