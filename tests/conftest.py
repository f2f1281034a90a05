"""Settings of the whole test run, and what is compiled once in it.

One thread a worker, and no deadlines on a shared machine.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "TRUEPOSE_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy is imported; workers of pytest-xdist inherit it
if os.environ.pop(
    "PYTHONDONTWRITEBYTECODE", ""
):  # else each process that tests start compiles all that it imports
    os.environ["PYTHONPYCACHEPREFIX"] = str(Path(tempfile.gettempdir()) / "truepose-bytecode")

import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

pytest.register_assert_rewrite("support")

from support.examples import examples  # noqa: E402
from support.generated_c import SANITIZERS, Built, build, has_sanitizers  # noqa: E402
from support.skips import NOTHING_BESIDE, SHARED, judge  # noqa: E402
from truepose.models.machine.builder import builders  # noqa: E402
from truepose.models.machine.effect import effects  # noqa: E402
from truepose.models.machine.sensor import sensors  # noqa: E402
from truepose.models.registry import PREFIX, Registry  # noqa: E402

settings.register_profile("truepose", deadline=None, derandomize=True, max_examples=25)
# for .ci/nightly: another seed each time, which --hypothesis-seed gives, so that nothing else may be remembered
settings.register_profile(
    "nightly", deadline=None, derandomize=False, database=None, max_examples=examples(100), print_blob=True
)
settings.load_profile("truepose")


def pytest_addoption(parser: pytest.Parser) -> None:
    """``--update-golden``: goldens of C, pages, commands, numbers and diagnoses."""
    told = "write tests/golden and tests/golden_* as they come out now"
    parser.addoption("--update-golden", action="store_true", help=told)


def pytest_configure(config: pytest.Config) -> None:
    """Before workers start, which inherit this: a shell's job in the background is started with SIGINT ignored."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Where nothing may be hidden, a skipped test has failed: see lib/support/skips.py."""
    report = yield
    judge(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """The same of a file that skips itself."""
    report = yield
    judge(report)
    return report


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder beside the checkout."""
    if not SHARED.is_dir():
        pytest.skip(NOTHING_BESIDE)
    return SHARED


@pytest.fixture(scope="session", autouse=True)
def _patience() -> Iterator[None]:
    """On a loaded machine a command takes longer than the two seconds after which it says what it does."""
    from truepose.commands import progress

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(progress, "DELAY", 600.0)
        yield


@contextmanager
def forgotten() -> Iterator[None]:
    """Names that are registered within, and plug-ins that are loaded, are not known afterwards."""
    known = set(sys.modules)
    registries: tuple[Registry[Any], ...] = (effects, sensors, builders)
    before = [{name: registry.get(name, "") for name in registry} for registry in registries]
    yield
    for registry, entries in zip(registries, before, strict=True):
        registry._entries = entries
    for name in set(sys.modules) - known:
        if name.startswith(PREFIX):
            del sys.modules[name]


@pytest.fixture(scope="module", autouse=True)
def _plugins_of_the_module() -> Iterator[None]:
    """What fixtures of a module load is known to that module only."""
    with forgotten():
        yield


@pytest.fixture(autouse=True)
def _plugins_of_the_test() -> Iterator[None]:
    """What a test loads is known to that test only, whatever runs after it."""
    with forgotten():
        yield


@pytest.fixture(scope="session")
def root_directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where C is generated and compiled, each machine once."""
    return tmp_path_factory.mktemp("codegen")


@pytest.fixture(scope="session")
def sanitizers(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The compiler's options that make it watch addresses and undefined behaviour."""
    if not has_sanitizers(tmp_path_factory.mktemp("sanitizers")):
        pytest.skip("the compiler has no sanitizers")
    return SANITIZERS


@pytest.fixture
def built(root_directory: Path, request: pytest.FixtureRequest) -> Built:
    """A machine's C, compiled; parametrized by ``support.generated_c.cases``."""
    return build(root_directory, *request.param)
