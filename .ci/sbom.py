"""Lists what an environment holds beside truepose (a software bill of materials, CycloneDX 1.6): python .ci/sbom.py PYTHON FILE

cyclonedx-py makes the list, without times and random numbers: the same environment gives the same bytes. Checked here: it has
every dependency of pyproject.toml, in a version that pyproject.toml allows, with where it is from and its licence.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"
OPTIONS = ["--output-reproducible", "--spec-version", "1.6", "--mc-type", "library", "--output-file", "-"]


def listed(python: Path, *options: str) -> str:
    """The list of an interpreter's environment, JSON, held against CycloneDX's schema but for the option --no-validate."""
    program = [sys.executable, "-m", "cyclonedx_py", "environment"]
    command = [*program, *OPTIONS, *options, "--pyproject", str(PROJECT), str(python)]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def faults(document: Mapping[str, Any], project: Mapping[str, Any]) -> list[str]:
    """What a list lacks of a project's dependencies, a line each."""
    components = {canonicalize_name(one["name"]): one for one in document.get("components", [])}
    root = document["metadata"]["component"]
    found = []
    if root["version"] != project["version"]:
        found.append(f"{root['name']}: found version {root['version']}, expected {project['version']}")
    for requirement in map(Requirement, project["dependencies"]):
        one = components.get(canonicalize_name(requirement.name), {})
        version = one.get("version", "none")
        if version == "none" or not requirement.specifier.contains(version, prereleases=True):
            found.append(f"{requirement.name}: found version {version}, expected {requirement.specifier}")
        found += [f"{requirement.name}: found no {key}" for key in ("purl", "licenses") if not one.get(key)]
    return found


def main() -> None:
    python, file = Path(sys.argv[1]), Path(sys.argv[2])
    text = listed(python)
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    if missing := faults(json.loads(text), project):
        sys.exit("\n".join(f"{file}: {one}" for one in missing))
    file.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
