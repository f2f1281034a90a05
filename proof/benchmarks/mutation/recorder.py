"""A pytest plug-in: what each test runs, as a line of JSON in the file named by ``MUTATION_RECORD``.

Only the functions' lines are seen: the lines of a module's own import belong to no test. What a file of tests runs while it
is imported counts as a fixture of its first test. CPU seconds, children's included.
A test that takes more than ``MUTATION_LIMIT`` CPU seconds is stopped: it would not be run against a mutant.
"""

from __future__ import annotations

import json
import os
import resource
import signal
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import coverage
import pytest

ROOT = Path.cwd()
LIMIT = float(os.environ["MUTATION_LIMIT"])
PRODUCT = [str(ROOT / folder / "*") for folder in ("models", "identification", "codegen", "src")]
_passed: dict[str, bool] = {}
_tracers: dict[str, coverage.Coverage] = {}
_imported: dict[str, dict[str, list[int]]] = {}
"""By file of tests: what it runs before the first of its tests."""


def _seconds() -> float:
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(u.ru_utime + u.ru_stime for u in used)


def _slow(_signal: int, _frame: FrameType | None) -> None:
    raise TimeoutError(f"more than {LIMIT} s")


def _tracer() -> coverage.Coverage:
    tracer = coverage.Coverage(data_file=None, include=PRODUCT, config_file=False)
    tracer.set_option("run:disable_warnings", ["no-data-collected"])
    tracer.start()
    return tracer


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Iterator[None]:
    """A file of tests may work while it is imported: for what its tests are parametrized by, or for its constants."""
    if not isinstance(collector, pytest.Module):
        return (yield)
    tracer = _tracer()
    try:
        return (yield)
    finally:
        tracer.stop()
        _imported[collector.nodeid] = _lines(tracer.get_data())


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Run one test under a trace of its own."""
    before, old = _seconds(), signal.signal(signal.SIGPROF, _slow)
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    tracer = _tracer()
    tracer.switch_context("setup")
    _tracers[item.nodeid] = tracer
    try:
        return (yield)
    finally:
        tracer.stop()
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, old)
        lines, setup = _lines(tracer.get_data()), _lines(tracer.get_data(), "setup")
        for file, imported in _imported.pop(item.nodeid.partition("::")[0], {}).items():
            setup[file] = sorted({*setup.get(file, ()), *imported})
        found = {
            "test": item.nodeid,
            "seconds": round(_seconds() - before, 3),
            "passed": _passed.get(item.nodeid, False),
            "lines": lines,
            "setup": setup,
        }
        with Path(os.environ["MUTATION_RECORD"]).open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(found) + "\n")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> None:
    """What ran so far were fixtures, which other tests of the file may share."""
    _tracers.pop(item.nodeid).switch_context("call")


def _lines(data: coverage.CoverageData, *contexts: str) -> dict[str, list[int]]:
    """By file from the root."""
    data.set_query_contexts(contexts or None)
    files = {
        str(Path(file).relative_to(ROOT)): sorted(data.lines(file) or ()) for file in data.measured_files()
    }
    return {file: lines for file, lines in files.items() if lines}


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Passed, where every phase did; a skipped test guards nothing."""
    _passed[report.nodeid] = report.passed and _passed.get(report.nodeid, True)
