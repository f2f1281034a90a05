"""What the product may not call, since it reads files of strangers: nothing that makes code or objects out of a text."""

from __future__ import annotations

import ast
from pathlib import Path

from support import TESTS

ROOT = TESTS.parent
MODULES = [
    path
    for folder in ("models", "identification", "codegen", "src/truepose")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if "src/truepose/models" not in str(path)
]
BARE = {"eval", "exec", "compile", "__import__"}
OF_MODULES = {
    ("pickle", "load"), ("pickle", "Unpickler"), ("marshal", "loads"), ("marshal", "load"), ("shelve", "open"),
    ("pd", "read_pickle"), ("joblib", "load"), ("os", "system"), ("os", "popen"), ("yaml", "unsafe_load"),
    ("yaml", "full_load"), ("yaml", "load_all"), ("pickle", "loads"), ("pd", "eval"), ("runpy", "run_path"),
    ("ElementTree", "parse"), ("ElementTree", "XML"), ("ElementTree", "fromstring"), ("importlib", "import_module"),
}  # fmt: skip
KNOWN = {
    ("models/builders/urdf_file.py", "ElementTree.fromstring"),  # what this program wrote a moment ago
    ("models/registry.py", "importlib.import_module"),  # modules of this package
    ("src/truepose/leaves.py", "importlib.import_module"),  # modules of this package
}
LOADERS = {"FastLoader", "PlainLoader"}


def calls(path: Path) -> list[str]:
    """Calls of a module that make something out of a text, as they are written."""
    out = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        function = node.func
        if isinstance(function, ast.Name) and function.id in BARE:
            out.append(function.id)
        if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
            pair = (function.value.id, function.attr)
            own = (
                pair == ("yaml", "load") and isinstance(node.args[1], ast.Name) and node.args[1].id in LOADERS
            )
            if pair in OF_MODULES or (pair == ("yaml", "load") and not own):
                out.append(".".join(pair))
            if function.attr == "from_string" or (function.attr == "Template" and pair[0] == "jinja2"):
                out.append(".".join(pair))  # a template out of a text
        told = {word.arg: word.value for word in node.keywords}
        for word in ("allow_pickle", "shell"):
            if word in told and not (isinstance(told[word], ast.Constant) and told[word].value is False):  # type: ignore[attr-defined]
                out.append(word)
    return out


def test_nothing_makes_code_out_of_texts() -> None:
    found = {(str(path.relative_to(ROOT)), call) for path in MODULES for call in calls(path)}
    assert found == KNOWN
