"""What is checked before a commit and by a host: with the project's own versions, scripts and commands."""

from __future__ import annotations

import os
import re
import tomllib
from typing import Any

import yaml

from support import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
README = (ROOT / "README.md").read_text(encoding="utf-8")
HOOKS = [
    hook
    for repo in yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
    for hook in repo["hooks"]
]
WORKFLOW: dict[str, Any] = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))
JOBS: dict[str, Any] = WORKFLOW["jobs"]


def runs(job: str) -> str:
    """The commands of a job."""
    return "\n".join(step["run"] for step in JOBS[job]["steps"] if "run" in step)


def pythons(job: str) -> list[str]:
    """The versions that a job is run with."""
    (asked,) = [
        step["with"]["python-version"]
        for step in JOBS[job]["steps"]
        if "setup-python" in step.get("uses", "")
    ]
    of_matrix = re.fullmatch(r"\$\{\{ matrix\.(\w+) \}\}", asked)
    return list(JOBS[job]["strategy"]["matrix"][of_matrix[1]]) if of_matrix else [asked]


def test_the_hooks_take_the_projects_ruff() -> None:
    (asked,) = [one for one in PROJECT["project"]["optional-dependencies"]["dev"] if one.startswith("ruff")]
    assert [hook["additional_dependencies"] for hook in HOOKS] == [[asked], [asked]]


def test_the_hooks_are_the_first_two_commands_of_ci() -> None:
    ours = re.findall(
        r"^\.ci/venv/bin/(ruff \w+)", (ROOT / ".ci/run").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert [" ".join(hook["entry"].split()[:2]) for hook in HOOKS] == ours == ["ruff check", "ruff format"]


def test_a_change_meets_the_whole_of_ci_with_the_oldest_python() -> None:
    assert runs("all") == ".ci/run" and os.access(ROOT / ".ci/run", os.X_OK)
    assert {"push", "pull_request"} <= WORKFLOW["on"].keys()
    assert [f">={version}" for version in pythons("all")] == [PROJECT["project"]["requires-python"]]


def test_a_change_meets_the_tests_with_every_newer_python_that_is_promised() -> None:
    prefix = "Programming Language :: Python :: 3."
    promised = [one.rpartition(" ")[2] for one in PROJECT["project"]["classifiers"] if one.startswith(prefix)]
    assert [*pythons("all"), *pythons("tests")] == promised
    (command,) = [line for line in README.splitlines() if "pytest" in line and line.startswith("python3")]
    assert runs("tests").splitlines() == ["source .ci/setup", command]


def test_a_release_is_tried_with_every_python_that_is_promised() -> None:
    (versions,) = pythons("release")
    assert versions.split()[::-1] == [*pythons("all"), *pythons("tests")]
    assert runs("release") == ".ci/release --all" and os.access(ROOT / ".ci/release", os.X_OK)
    assert ".ci/release" in (ROOT / ".ci/run").read_text(encoding="utf-8")


def test_the_night_is_that_of_ci_and_no_change_waits_for_it() -> None:
    assert runs("night") == ".ci/nightly" and os.access(ROOT / ".ci/nightly", os.X_OK)
    assert WORKFLOW["on"]["schedule"]
    assert {name: job["if"] for name, job in JOBS.items()} == {
        "all": "github.event_name != 'schedule'",
        "tests": "github.event_name != 'schedule'",
        "release": "github.event_name != 'schedule'",
        "night": "github.event_name == 'schedule'",
    }
