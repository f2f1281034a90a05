"""One mutant in a copy of the tree: its tests run in a forked child of a process that has imported the heavy packages.

A child imports truepose itself, which has the change; numpy, casadi, pytest and their like are there already, which
saves two seconds of three.
"""

from __future__ import annotations

import compileall
import importlib
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import time
import traceback
from pathlib import Path

from .covering import settings
from .mutants import Mutant

HEAVY = (
    "numpy scipy.optimize scipy.stats scipy.spatial.transform pandas pyarrow.parquet casadi pydantic pint yaml typer.testing \
rich.console jinja2 hypothesis pytest _pytest.assertion.rewrite multiprocessing.pool"
)
NOT_COPIED = shutil.ignore_patterns(
    ".git", ".venv", "*.egg-info", ".mypy_cache", ".ruff_cache", ".hypothesis", "build"
)
OPTIONS = "-x -q -p no:cacheprovider -p no:xdist -p no:nbmake -o addopts=--import-mode=importlib \
-W ignore::pytest.PytestAssertRewriteWarning"
"""The project's own options are for many tests and several workers. The warning: hypothesis is there before pytest starts."""
WALL = 1800.0
"""Seconds after which a child hangs, however busy the machine is."""


def copied(root: Path, tree: Path) -> Path:
    """The tree without what no test needs, links kept."""
    if not tree.exists():
        shutil.copytree(root, tree, symlinks=True, ignore=NOT_COPIED)
        # children write no bytecode, and would compile all of it again
        compileall.compile_dir(str(tree), quiet=2)
    return tree


def outcome(root: Path, scratch: Path, mutant: Mutant, tests: list[str], seconds: float) -> tuple[str, float]:
    """``killed``, ``survived`` or ``timeout``, and the CPU seconds that it took. Tests take ``seconds`` without it."""
    if not tests:
        return "survived", 0.0
    for name in HEAVY.split():
        importlib.import_module(name)
    tree = scratch / f"tree-{os.getpid()}"
    (scratch / "tmp").mkdir(exist_ok=True)
    if not tree.exists() and (code := _tested(copied(root, tree), tests, seconds)[0]):
        raise RuntimeError(f"{tree}: tests of the unchanged code end with {code}: see {tree}.log; {tests}")
    file = tree / mutant.file
    source, times = file.read_bytes(), file.stat()
    file.write_bytes(mutant.applied(source))
    try:
        code, used = _tested(tree, tests, seconds)
        if code == 4:  # a parameter's name has changed with the mutant
            code, used = _tested(tree, list(dict.fromkeys(t.partition("[")[0] for t in tests)), seconds)
    finally:
        file.write_bytes(source)
        os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    timeout = code in (-signal.SIGXCPU, -signal.SIGKILL)
    return "timeout" if timeout else "killed" if code else "survived", used


def _tested(tree: Path, tests: list[str], seconds: float) -> tuple[int, float]:
    """pytest's exit code, or minus the signal that ended it, and its CPU seconds."""
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        _child(tree, tests, round(30.0 + 4.0 * seconds))
    end, before = time.monotonic() + WALL, resource.getrusage(resource.RUSAGE_CHILDREN)
    while os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
        if time.monotonic() > end:
            os.killpg(child, signal.SIGKILL)
        time.sleep(0.02)
    _, status = os.waitpid(child, 0)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return os.waitstatus_to_exitcode(status), used


def _child(tree: Path, tests: list[str], limit: int) -> None:
    """Run the tests and end; a change may lead anywhere, so nothing of it reaches the parent."""
    code = 3
    try:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
        os.chdir(tree)
        os.environ.update(settings(tree))
        # tests that call themselves a worker's keep compiled evaluators beside their folder: all mutants share them
        os.environ |= {"PYTHONDONTWRITEBYTECODE": "1", "PYTEST_XDIST_WORKER": tree.name}
        sys.dont_write_bytecode = True
        sys.path[:0] = [str(tree / "src"), str(tree)]
        # as without workers of joblib, whose way to start processes no program that is started knows
        multiprocessing.set_start_method("fork", force=True)
        log = os.open(tree.with_suffix(".log"), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(log, 1)
        os.dup2(log, 2)
        pytest = importlib.import_module("pytest")
        where = [f"--rootdir={tree}", f"--basetemp={tree.parent / 'tmp' / tree.name}"]
        code = int(pytest.main([*OPTIONS.split(), *where, *tests]))
        sys.stdout.flush()
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)
