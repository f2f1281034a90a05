"""The lock for development, and the list of what a wheel brings with it."""

from __future__ import annotations

import importlib.metadata
import re
import sys
import tomllib
from collections.abc import Iterator

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from support import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LOCK = [
    Requirement(line)
    for line in (ROOT / "requirements-dev.lock").read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
]
PYTHONS = [one.rpartition(" ")[2] for one in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", one)]


def environment(version: str) -> dict[str, str]:
    """What markers see of a Python."""
    return {
        **{key: str(value) for key, value in default_environment().items()},
        "python_version": version,
        "python_full_version": f"{version}.9",
    }


def pins(version: str) -> dict[str, str]:
    """Versions by name for a Python."""
    there = environment(version)
    applying = [one for one in LOCK if one.marker is None or one.marker.evaluate(there)]
    found: dict[str, str] = {
        canonicalize_name(one.name): next(iter(one.specifier)).version for one in applying
    }
    assert len(found) == len(applying), "two versions of one package"
    return found


def direct() -> list[Requirement]:
    """What ``pip install '.[dev]'`` names."""
    extras = PROJECT["optional-dependencies"]
    named = map(Requirement, [*PROJECT["dependencies"], *extras["dev"], *extras["docs"]])
    return [one for one in named if one.name != PROJECT["name"]]


def test_the_lock_has_versions_and_nothing_else() -> None:
    assert [str(one) for one in LOCK if [item.operator for item in one.specifier] != ["=="]] == []
    assert not any(one.extras or one.url for one in LOCK)  # pip takes no constraint that has them


@pytest.mark.parametrize("version", PYTHONS)
def test_the_lock_keeps_the_bounds_of_the_project(version: str) -> None:
    locked = pins(version)
    outside = {
        str(one): locked.get(canonicalize_name(one.name))
        for one in direct()
        if not one.specifier.contains(locked.get(canonicalize_name(one.name), "0"))
    }
    assert not outside


def needed(names: list[Requirement]) -> Iterator[str]:
    """Installed packages that requirements lead to, themselves included; for this Python."""
    seen: set[tuple[str, tuple[str, ...]]] = set()
    waiting = list(names)
    while waiting:
        one = waiting.pop()
        key = canonicalize_name(one.name), tuple(sorted(one.extras))
        if key in seen:
            continue
        seen.add(key)
        try:
            requires = importlib.metadata.requires(one.name) or []
        except importlib.metadata.PackageNotFoundError:
            continue  # one that this environment was made without
        yield key[0]
        for text in requires:
            other = Requirement(text)
            extras = one.extras or {""}
            if other.marker is None or any(other.marker.evaluate({"extra": extra}) for extra in extras):
                waiting.append(other)


def test_the_lock_has_all_that_is_installed() -> None:
    """Not only what the project names: a version for each package that these bring."""
    locked = pins(f"{sys.version_info.major}.{sys.version_info.minor}")
    found = set(needed(direct()))
    assert len(found) > len(direct())
    assert found - locked.keys() == set()
