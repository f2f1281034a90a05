"""What documents and docstrings name is there: files, folders, modules, and what they hold."""

from __future__ import annotations

import importlib
import importlib.util
import re
from pathlib import Path

import pytest

from support import ROOT
from truepose.errors import InputError

PROOF = ROOT / "proof"
TOPS = ("models", "identification", "codegen", "src", "proof", "tests", "examples", "docs")
IN_PROOF = ("challenge", "benchmarks", "golden_diagnoses", "compensation_loop")
"""Packages that run in ``proof/``, whose own texts name their files from there."""
TOLD = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")
RESULTS = sorted(PROOF.glob("*/results/*.md"))
DOCUMENTS = [*(ROOT / name for name in TOLD), *sorted((ROOT / "docs").rglob("*.md")), *RESULTS]
SOURCES = sorted(
    path
    for top in TOPS
    for path in (ROOT / top).rglob("*.py")
    if path.resolve() == ROOT.resolve() / path.relative_to(ROOT)  # not through the links
)
FILES = {
    path.relative_to(ROOT).as_posix() for top in TOPS for path in (ROOT / top).rglob("*") if path.is_file()
}
QUOTED = re.compile(r"`+([^`\n]+)`+")
PLACE = re.compile(rf"^(?:{'|'.join((*TOPS, *IN_PROOF))})(?:/[\w.*-]+)*/?$")
MODULE_FILE = re.compile(r"^(?:[\w.*-]+/)*[\w*]+\.py$")
DOTTED = re.compile(r"(?<!://)\btruepose(?:\.[A-Za-z_]\w*)+")
"""Modules and what they hold; an address is neither."""
RUN = re.compile(rf"python3? -m ((?:{'|'.join(IN_PROOF)}|examples|truepose)[\w.]*)")
WRITTEN = re.compile(r"(?:^|/)NAME_|^travel_cubic\.py$|CASE")
"""Generated files, the reader's own, and words that stand for any name."""
MADE_UP = {"tests/docs/test_names.py", "tests/project/test_imports.py", "tests/whole/commands/test_cli.py"}
"""These ask for modules because they are not there."""


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _bases(path: Path) -> tuple[Path, ...]:
    """Where a text may name files from, beside the checkout: the history names those that moved to ``proof/``."""
    return (PROOF,) if PROOF in path.parents or path.name == "CHANGELOG.md" else ()


def _stands(dotted: str) -> bool:
    """Whether a module of that name can be imported, or a module before its end holds the rest."""
    parts = dotted.split(".")
    for end in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:end]))
        except (ModuleNotFoundError, InputError) as exc:
            lacks = exc if isinstance(exc, ModuleNotFoundError) else exc.__cause__
            missing = str(getattr(lacks, "name", "truepose"))
            if not missing.startswith("truepose") and importlib.util.find_spec(".".join(parts[:end])):
                return True  # an extra is missing: the module is there, what it holds cannot be asked
            continue
        for part in parts[end:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def _missing(text: str, *bases: Path) -> list[str]:
    """Files, folders and modules that a text names in backticks, or runs, and that are not below the ``bases``."""
    out = []
    for quoted in QUOTED.findall(text):
        if WRITTEN.search(quoted):
            continue
        if PLACE.match(quoted) and "/" in quoted:
            out += [] if any(any(base.glob(quoted.rstrip("/"))) for base in (ROOT, *bases)) else [quoted]
        elif MODULE_FILE.match(quoted):
            pattern = re.compile(rf"(?:^|/){re.escape(quoted).replace(chr(92) + '*', '[^/]*')}$")
            out += [] if any(map(pattern.search, FILES)) else [quoted]
    for module in RUN.findall(text):
        place = module.removeprefix("truepose.").replace(".", "/")
        ends = (f"{place}.py", f"{place}/__main__.py")
        out += (
            [] if {top + end for top in ("", "src/truepose/", "proof/") for end in ends} & FILES else [module]
        )
    return out + [dotted for dotted in DOTTED.findall(text) if not _stands(dotted)]


@pytest.mark.parametrize("document", DOCUMENTS, ids=_name)
def test_what_a_document_names_is_there(document: Path) -> None:
    assert _missing(document.read_text(encoding="utf-8"), *_bases(document)) == []


@pytest.mark.parametrize("top", TOPS)
def test_what_docstrings_and_comments_name_is_there(top: str) -> None:
    sources = [path for path in SOURCES if _name(path).startswith(f"{top}/") and _name(path) not in MADE_UP]
    assert sources or top == "docs"
    missing = {_name(path): _missing(path.read_text(encoding="utf-8"), *_bases(path)) for path in sources}
    assert {name: names for name, names in missing.items() if names} == {}


def _studies() -> list[Path]:
    """What can be run of the studies: modules, and folders that run as one."""
    found = [path for top in ("benchmarks", "challenge/studies") for path in (PROOF / top).rglob("*.py")]
    runs = [path for path in found if '__name__ == "__main__"' in path.read_text(encoding="utf-8")]
    whole = {path.parent for path in runs if path.name == "__main__.py"}
    return [*sorted(whole), *(path for path in runs if not whole & set(path.parents))]


@pytest.mark.parametrize("kept", [*_studies(), *RESULTS], ids=_name)
def test_a_page_names_every_study_and_every_table_of_results(kept: Path) -> None:
    """What no page needs goes: studies are kept for what the pages say."""
    told = [path for path in DOCUMENTS if path not in (ROOT / "CHANGELOG.md", kept)]
    pages = "\n".join(path.read_text(encoding="utf-8") for path in told)
    module = kept.relative_to(PROOF).as_posix().removesuffix(".py").replace("/", ".")
    names = (re.escape(_name(kept)), re.escape(module), rf"python -m {re.escape(kept.stem)}")
    assert re.search(rf"\b(?:{'|'.join(names)})\b", pages)
