"""A YAML file with other values, its comments and layout kept."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq
from ruamel.yaml.error import YAMLError
from ruamel.yaml.util import load_yaml_guess_indent

from truepose.errors import InputError
from truepose.models.file.yaml_document import document_text, parse_document

_UNBROKEN = 10**6


def edited_text(text: str, document: Mapping[str, Any]) -> str:
    """The text of a YAML file, changed where its values differ from those of ``document``.

    What stays keeps its comments, order and layout. Where that cannot be done the document is written anew: what the result
    holds is ``document`` in any case.
    """
    try:
        before = parse_document(text, "")
        editor = _editor(text)
        held = editor.load(text)
        _settle(held, before, document)
        stream = io.StringIO()
        editor.dump(held, stream)
        if parse_document(stream.getvalue(), "") == document:
            return stream.getvalue()
    except (YAMLError, InputError, ValueError, TypeError):
        pass  # an exotic file, such as one with aliases into what changed
    return document_text(document)


def _editor(text: str) -> YAML:
    """A reader and writer that lays out as the text does."""
    dash = load_yaml_guess_indent(text)[2]
    offset = 2 if dash is None else dash
    mapping = re.search(r"^[^\s#][^#\n]*:\s*\n(?:\s*#.*\n)*( +)[^\s#-]", text, re.MULTILINE)
    editor = YAML()
    editor.preserve_quotes, editor.width = True, _UNBROKEN
    editor.indent(mapping=len(mapping[1]) if mapping else 2, sequence=offset + 2, offset=offset)
    return editor


def _settle(held: Any, before: Any, after: Any) -> None:
    """Set in ``held`` (a mapping or a list, as the editor reads it) what ``before`` and ``after`` do not share."""
    if isinstance(after, Mapping):
        for key in [k for k in before if k not in after]:
            del held[key]
        for key, value in after.items():
            _settle_one(held, key, before.get(key, _NOTHING), value)
        return
    for place, value in enumerate(after):
        _settle_one(held, place, before[place], value)


def _settle_one(held: Any, key: Any, before: Any, after: Any) -> None:
    alike = isinstance(before, Mapping) and isinstance(after, Mapping)
    both = isinstance(before, list) and isinstance(after, list) and len(before) == len(after)
    if alike or both:
        _settle(held[key], before, after)
    elif type(before) is not type(after) or before != after:
        held[key] = _laid_out(after)


def _laid_out(value: Any) -> Any:
    """A new value: lists of plain values on one line, as everywhere in machine files."""
    if isinstance(value, Mapping):
        return {key: _laid_out(item) for key, item in value.items()}
    if not isinstance(value, list):
        return value
    items = CommentedSeq([_laid_out(item) for item in value])
    if not any(isinstance(item, Mapping | list) for item in value):
        items.fa.set_flow_style()
    return items


_NOTHING = object()
