"""YAML texts in and out: safe tags only, no duplicate keys, numbers as YAML 1.2 writes them.

PyYAML follows YAML 1.1, in which ``1e-4`` is a text; here it is a number, and a text that looks like a
number is quoted when written, so that every document reads back as it was.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from truepose.errors import InputError
from truepose.files import read_input
from truepose.models.file.limits import ENTRIES

_FLOAT: Final = re.compile(
    r"""^(?:[-+]?(?:\.[0-9]+|[0-9]+\.[0-9]*)(?:[eE][-+]?[0-9]+)?
    |[-+]?[0-9]+[eE][-+]?[0-9]+|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$""",
    re.VERBOSE,
)
_INTEGER: Final = re.compile(r"^[-+]?(?:0|[1-9][0-9]*)$")
"""Whole numbers that mean the same to every reader: to some 0127 is 87, 2:07 is 127 and 1_000 is 1000."""
_SEPARATORS: Final = (",", ":", "[", "{", "- ", "-\n", "? ")
"""Each value of a document has one of these before it or behind."""
_TAG: Final = "tag:yaml.org,2002:"
_MOST_DIGITS = 250
"""Of a whole number, as many as a float holds in any base: no field takes more, and a million of them take long to read."""
_LARGEST = 1_000_000  # nodes, aliases written out: a few lines of aliases can stand for billions
_LONG = 1 << 20
"""Characters beyond which what C refuses is not read again in Python for a better message."""


def _refuse(problem: str, node: yaml.Node) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)


class _Checks:
    """What a loader refuses beside bad syntax: duplicate keys, keys that are no text, and endless aliases."""

    def get_single_node(self) -> yaml.Node | None:
        node: yaml.Node | None = super().get_single_node()  # type: ignore[misc]
        if node is not None and self._size(node, {}) > _LARGEST:
            raise _refuse("the document is too large once its aliases are written out", node)
        return node

    def _size(self, node: yaml.Node, sizes: dict[int, int]) -> int:
        if id(node) in sizes:
            if sizes[id(node)] == 0:  # met again inside itself
                raise _refuse("an alias contains itself", node)
            return sizes[id(node)]
        sizes[id(node)] = 0
        size = 1
        if isinstance(node, yaml.MappingNode):
            self._check_keys(node)
            size += sum(self._size(item, sizes) for pair in node.value for item in pair)
        elif isinstance(node, yaml.SequenceNode):
            size += sum(self._size(item, sizes) for item in node.value)
        sizes[id(node)] = size
        return size

    def _check_keys(self, node: yaml.MappingNode) -> None:
        seen: set[str] = set()
        for key, _ in node.value:
            if key.tag not in {_TAG + "str", _TAG + "merge"}:
                kind = str(key.tag).removeprefix(_TAG)
                raise _refuse(f"field name {key.value!r} is read as {kind}, put it in quotes", key)
            if key.value in seen:
                raise _refuse(f"duplicate key {key.value!r}", key)
            seen.add(key.value)


def _whole_number(loader: Any, node: yaml.ScalarNode) -> int:
    """A whole number that is no larger than a float can be."""
    if len(node.value) > _MOST_DIGITS:
        raise _refuse(f"a number of {len(node.value)} characters, expected at most {_MOST_DIGITS}", node)
    return int(loader.construct_yaml_int(node))


class PlainLoader(_Checks, yaml.SafeLoader):
    """SafeLoader with these checks."""


class FastLoader(_Checks, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """The same in C, five times as fast, where PyYAML was built with it; it says less of what it refuses."""


class _Dumper(yaml.SafeDumper):
    """SafeDumper that writes lists of plain values on one line and takes NumPy values."""

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def represent_data(self, data: Any) -> yaml.Node:
        if isinstance(data, np.generic | np.ndarray):
            data = data.tolist()
        if isinstance(data, (list, tuple)):
            flat = not any(isinstance(item, (list, tuple, Mapping, np.ndarray)) for item in data)
            return self.represent_sequence(_TAG + "seq", data, flow_style=flat)
        if isinstance(data, Mapping):
            return self.represent_mapping(_TAG + "map", data.items())
        return super().represent_data(data)


def _use_numbers_of_yaml_1_2(kind: Any, **patterns: re.Pattern[str]) -> None:
    """Let plain texts be numbers by these patterns, by their tag, and by no other."""
    tags = {_TAG + name: pattern for name, pattern in patterns.items()}
    resolvers = {
        first: [(tag, pattern) for tag, pattern in rules if tag not in tags]
        for first, rules in kind.yaml_implicit_resolvers.items()
    }
    for first in "-+0123456789.":
        resolvers.setdefault(first, [])[0:0] = tags.items()
    kind.yaml_implicit_resolvers = resolvers


for _kind in (PlainLoader, FastLoader):
    _kind.add_constructor(_TAG + "int", _whole_number)
_use_numbers_of_yaml_1_2(PlainLoader, float=_FLOAT, int=_INTEGER)
_use_numbers_of_yaml_1_2(FastLoader, float=_FLOAT, int=_INTEGER)
_use_numbers_of_yaml_1_2(_Dumper, float=_FLOAT)  # what any reader takes for a number stays in quotes


def read_document(path: Path | str) -> dict[str, Any]:
    """The mapping a YAML file holds.

    Raises InputError, naming file and line, for an unreadable file, a syntax error, a duplicate key, an
    unsafe tag, or a document that is not a mapping with text keys.
    """
    return parse_document(read_text(path), path)


def read_text(path: Path | str) -> str:
    """The text of a file in UTF-8. Raises InputError for one that cannot be read or is too large."""
    try:
        return read_input(Path(path)).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except (OSError, ValueError) as exc:
        reason = exc.strerror if isinstance(exc, OSError) else "not a text in UTF-8"
        if isinstance(exc, ValueError) and not isinstance(exc, UnicodeDecodeError):
            reason = str(exc)  # a path that no file can have
        raise InputError(f"{path}: cannot read the file: {reason}") from None


def parse_document(text: str, path: Path | str) -> dict[str, Any]:
    """The mapping that the text of the file ``path`` holds. Raises InputError as `read_document`."""
    _check_length(text, path)
    try:
        document = _loaded(text)
    except yaml.MarkedYAMLError as exc:
        mark = exc.problem_mark or exc.context_mark
        line = f"line {mark.line + 1}: " if mark else ""
        raise InputError(f"{path}: {line}{exc.problem or exc.context}") from None
    except (
        yaml.YAMLError,
        ValueError,
        LookupError,
    ) as exc:  # PyYAML raises these of a tag such as !!bool abc
        reason = (
            str(exc).splitlines()[0]
            if isinstance(exc, (yaml.YAMLError, ValueError))
            else f"found {exc} under a tag"
        )
        raise InputError(f"{path}: not valid YAML: {reason}") from None
    except RecursionError:
        raise InputError(f"{path}: nested too deeply") from None
    if not isinstance(document, dict):
        raise InputError(f"{path}: expected a mapping of fields, found {type(document).__name__}")
    return document


def _loaded(text: str) -> Any:
    """What a text holds. What C refuses is read again in Python, which says what is wrong and where."""
    try:
        return yaml.load(text, FastLoader)
    except (yaml.YAMLError, ValueError, RecursionError):
        if len(text) > _LONG:
            raise
        return yaml.load(text, PlainLoader)


def _check_length(text: str, path: Path | str) -> None:
    """Refuse what would take minutes to read, before it is read."""
    entries = sum(text.count(sign) for sign in _SEPARATORS)
    if entries > ENTRIES:
        raise InputError(f"{path}: found about {entries:,} values, expected at most {ENTRIES:,}")


def flow_text(value: Any) -> str:
    """A value as YAML on one line: ``{name: q1, range: [-3, 3]}``."""
    text = yaml.dump(
        value, Dumper=_Dumper, default_flow_style=True, sort_keys=False, allow_unicode=True, width=10**6
    )
    return text.removesuffix("...\n").strip()


class LongText(str):
    """Letters, digits and ``+/=`` by the million, which are written in lines as they are: PyYAML looks at each of them."""


def document_text(document: Mapping[str, Any]) -> str:
    """A mapping as YAML: key order kept, floats at full precision, flat lists on one line."""
    long: list[LongText] = []
    bare = _without_long(document, long)
    text = yaml.dump(bare, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)
    for k, item in enumerate(long):
        line = next(line for line in text.splitlines() if line.endswith(f": {_MARK}{k}"))
        indent = "  " * (1 + (len(line) - len(line.lstrip())) // 2)
        rows = [f"{indent}{item[at : at + _LINE]}" for at in range(0, len(item), _LINE)]
        text = text.replace(f": {_MARK}{k}\n", "\n".join([": |-", *rows, ""]), 1)
    return text


_MARK: Final = "long-text-that-follows-"
_LINE: Final = 110


def _without_long(value: Any, long: list[LongText]) -> Any:
    """The same with marks in place of long texts, which are collected."""
    if isinstance(value, LongText):
        long.append(value)
        return f"{_MARK}{len(long) - 1}"
    if isinstance(value, Mapping):
        return {key: _without_long(item, long) for key, item in value.items()}
    return [_without_long(item, long) for item in value] if isinstance(value, list) else value
