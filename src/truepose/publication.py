"""Several files of one result, published in one step: a single rename decides which result is seen.

A folder that is new is renamed into place whole. One that is there keeps its other files, and it may be somebody's
working directory or a mount, so that another folder cannot take its place. There every name of the result
first becomes a link that leads through ``stage/now`` to its old file (or to none, where it is new); then one
rename makes ``now`` lead to the new files, all names at once; then each new file takes the place of its link.
Killed anywhere, the folder shows all old files or all new ones, and ``settle`` brings it to an end.

Where a file system has no links the files are renamed one after another; ``settle`` then finishes what was begun.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

from truepose.errors import InputError
from truepose.stopping import stopping

NEW, OLD, NOW = "new", "old", "now"
LONG = 200
"""Bytes of a name from which on a brief one stands for it in the name of what is not finished."""


def publish(stage: Path, target: Path) -> None:
    """Let the files of ``stage/new`` be those of ``target``, in one step; the stage is gone afterwards.

    A stage is beside its target or inside. Raises InputError where a folder is in the way of a file, OSError
    where something cannot be written; the target then is as it was. Ctrl-C is heard before or afterwards.
    """
    if not target.exists():
        with stopping.undisturbed():
            clear(target, stage)
            (stage / NEW).rename(target)
            stopping.written.append(str(target))
            shutil.rmtree(stage)
        return
    with held(target), stopping.undisturbed():
        clear(target, stage)
        try:
            _turn(stage, target)
            stopping.written.append(str(target))
        finally:
            settle(stage, target)


@contextlib.contextmanager
def claimed(target: Path, make: Callable[[Path], None]) -> Iterator[Path]:
    """What is to become ``target``, made and locked: inside a folder that is there, else beside it; its name is hidden.

    Made again where another run took it for abandoned before it was locked. Nothing of it is left behind, unless the
    target depends on it.
    """
    while True:
        name = f"{uuid.uuid4().hex[:12]}.partial"
        stage = target / f".{name}" if target.is_dir() else target.with_name(f".{_brief(target.name)}.{name}")
        with contextlib.ExitStack() as lock:
            try:
                with stopping.undisturbed():
                    make(stage)
                    lock.enter_context(held(stage))
                if stage.exists():
                    yield stage
                    return
            finally:
                with stopping.undisturbed():
                    _abandon(stage)


def _brief(name: str) -> str:
    """A name that something can be added to: names have 255 bytes on most systems."""
    return name if len(os.fsencode(name)) <= LONG else hashlib.sha256(os.fsencode(name)).hexdigest()


def _abandon(stage: Path) -> None:
    if stage.is_dir():
        if not begun(stage):
            shutil.rmtree(stage, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            stage.unlink()


def clear(target: Path, own: Path) -> None:
    """Settle or remove what killed runs left of ``target``, beside it and inside; ``own`` and what lives stays."""
    for home, name in ((target.parent, re.escape(f".{_brief(target.name)}")), (target, "")):
        ours = re.compile(name + r"\.[0-9a-f]{12}\.partial")
        with contextlib.suppress(OSError):  # a folder that may not be listed
            for found in os.listdir(home) if home.is_dir() else ():  # noqa: PTH208 -- names alone: there may be 10^5
                if ours.fullmatch(found) and (left := home / found) != own:
                    with held(left, wait=False) as dead:
                        if dead:
                            settle(left, target)


@contextlib.contextmanager
def held(path: Path, *, wait: bool = True) -> Iterator[bool]:
    """The lock of a file or folder, for as long as the block or the process lasts; False where another has it.

    Where there are no such locks everyone has it: two runs should not write to one place at once there.
    """
    try:
        import fcntl

        place = os.open(path, os.O_RDONLY)
    except (ImportError, OSError):
        yield True
        return
    try:
        fcntl.flock(place, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        got = True
    except OSError as exc:
        got = not isinstance(exc, BlockingIOError)
    try:
        yield got
    finally:
        os.close(place)


def _files(folder: Path) -> list[Path]:
    """Files below a folder, relative to it."""
    inside = folder.resolve()
    return sorted(path.relative_to(inside) for path in inside.rglob("*") if not path.is_dir())


def _folders(folder: Path) -> list[Path]:
    """Folders below a folder, relative to it, outer ones first."""
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_dir())


def _turn(stage: Path, target: Path) -> None:
    """All that is done before the new files are seen, and the rename that shows them."""
    names, folders = _files(stage / NEW), _folders(stage / NEW)
    for name in names:
        if (target / name).is_dir():
            raise InputError(f"{target / name}: expected a file, found a directory")
    for folder in folders:
        if (target / folder).exists() and not (target / folder).is_dir():
            raise InputError(f"{target / folder}: expected a directory, found a file")
    spare = stage / "spare"
    try:
        if os.name == "nt":  # no link to a folder can be renamed over another there
            raise NotImplementedError
        spare.symlink_to(OLD)
    except (OSError, NotImplementedError):
        (stage / NEW).rename(stage / NOW)
        return
    (stage / OLD).mkdir()
    for folder in folders:
        if (target / folder).is_dir():
            (stage / OLD / folder).mkdir()
    for name in names:
        _keep(target / name, stage / OLD / name)
    spare.replace(stage / NOW)
    for folder in folders:
        (target / folder).mkdir(exist_ok=True)
    for name in names:
        place = target / name
        spare.symlink_to(os.path.relpath(stage / NOW / name, place.parent.resolve()))
        spare.replace(place)
    spare.symlink_to(NEW)
    spare.replace(stage / NOW)


def _keep(place: Path, copy: Path) -> None:
    """The file at ``place`` under a second name, if there is one."""
    if place.is_symlink():
        copy.symlink_to(place.parent / place.readlink())
    elif place.exists():
        try:
            copy.hardlink_to(place)
        except (OSError, NotImplementedError):
            shutil.copy2(place, copy)


def begun(stage: Path) -> bool:
    """Whether what is in the target depends on the stage."""
    return (stage / NOW).is_symlink() or (stage / NOW).exists()


def settle(stage: Path, target: Path) -> None:
    """End what ``publish`` began: forward once the new files are seen, else back; then the stage goes."""
    now = stage / NOW
    if not stage.is_dir():  # the beginning of a single file
        stage.unlink(missing_ok=True)
        return
    if now.is_symlink() and now.readlink() == Path(OLD):
        _undo(stage, target)
    elif now.is_dir():
        for folder in _folders(now.resolve()):
            (target / folder).mkdir(exist_ok=True)
        for name in _files(now):
            (now / name).replace(target / name)
    if now.is_symlink():
        now.unlink()  # before what it stands for
    shutil.rmtree(stage)


def _undo(stage: Path, target: Path) -> None:
    """Old files in the places of their links."""
    for name in _files(stage / NEW):
        place, old = target / name, stage / OLD / name
        if place.is_symlink() and stage.name in place.readlink().parts:
            if old.exists() or old.is_symlink():
                old.replace(place)
            else:
                place.unlink()
    for folder in reversed(_folders(stage / NEW)):
        if not (stage / OLD / folder).is_dir():
            with contextlib.suppress(OSError):
                (target / folder).rmdir()


__all__ = ["NEW", "begun", "claimed", "clear", "held", "publish", "settle"]
