"""Mutation of YAML documents by their structure: what comes out is mostly YAML, and mostly no machine."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Any

from fuzzing import texts


class Raw(str):
    """A value as it is to be written."""


@dataclass
class Map:
    """A mapping by its pairs: keys may be there twice."""

    pairs: list[tuple[str, Any]]


Node = Any


def tree(value: Any) -> Node:
    """A document as nodes."""
    if isinstance(value, dict):
        return Map([(str(key), tree(item)) for key, item in value.items()])
    return [tree(item) for item in value] if isinstance(value, list) else value


def text(node: Node) -> str:
    """A document in flow style."""
    if isinstance(node, Raw):
        return str(node)
    if isinstance(node, Map):
        return "{" + ", ".join(f"{key}: {text(item)}" for key, item in node.pairs) + "}"
    if isinstance(node, list):
        return "[" + ", ".join(map(text, node)) + "]"
    if isinstance(node, float) and node in (float("inf"), float("-inf")):
        return ".inf" if node > 0 else "-.inf"
    return json.dumps(node, ensure_ascii=False)


def mutated(rng: Random, document: dict[str, Any]) -> str:
    """The text of a document with one flaw or some; keys of the top stand on lines of their own."""
    root = tree(document)
    for _ in range(rng.choice((1, 1, 1, 1, 2, 3, 6))):
        root = _flawed(rng, root)
    if not isinstance(root, Map):
        return text(root)
    return "".join(f"{key}: {text(item)}\n" for key, item in root.pairs)


def _places(node: Node, at: tuple[int, ...] = ()) -> list[tuple[int, ...]]:
    """Where all nodes below one are: indices of pairs or items."""
    inner = (
        [item for _, item in node.pairs] if isinstance(node, Map) else node if isinstance(node, list) else []
    )
    out = [(*at, k) for k in range(len(inner))]
    for k, item in enumerate(inner):
        out += _places(item, (*at, k))
    return out


def _get(node: Node, at: tuple[int, ...]) -> Node:
    for k in at:
        node = node.pairs[k][1] if isinstance(node, Map) else node[k]
    return node


def _flawed(rng: Random, root: Node) -> Node:
    places = _places(root)
    if not places:
        return Raw(texts.value(rng))
    at = rng.choice(places)
    holder, k = _get(root, at[:-1]), at[-1]
    own = _get(holder, (k,))
    other = _get(root, rng.choice(places))
    change = rng.choices(CHANGES, WEIGHTS)[0]
    if isinstance(holder, Map):
        key = holder.pairs[k][0]
        holder.pairs[k : k + 1] = [
            (key if name is None else name, item) for name, item in change(rng, own, other)
        ]
    else:
        holder[k : k + 1] = [item for _, item in change(rng, own, other)]
    return root


Pairs = list[tuple[str | None, Node]]


def _value(rng: Random, own: Node, other: Node) -> Pairs:
    return [(None, Raw(texts.value(rng)))]


def _number(rng: Random, own: Node, other: Node) -> Pairs:
    if isinstance(own, (int, float)) and not isinstance(own, bool) and rng.random() < 0.6:
        return [
            (None, own * 10.0 ** rng.randint(-6, 6) * rng.choice((1, 1, -1)) * rng.choice((1, rng.random())))
        ]
    return [(None, Raw(texts.number(rng)))]


def _gone(rng: Random, own: Node, other: Node) -> Pairs:
    return []


def _twice(rng: Random, own: Node, other: Node) -> Pairs:
    return [(None, own)] * rng.choice((2, 2, 2, 3, 40, 700))


def _renamed(rng: Random, own: Node, other: Node) -> Pairs:
    return [(rng.choice(("", "name", "q1", "'': x", "0", "a.b", '"\\u202e"', "<<", "type", "z" * 300)), own)]


def _swapped(rng: Random, own: Node, other: Node) -> Pairs:
    return [(None, copy.deepcopy(other))]  # it may hold the place itself


def _wrapped(rng: Random, own: Node, other: Node) -> Pairs:
    return [(None, rng.choice(([own], [own, own], Map([("x", own)]), [], None, [[own]])))]


def _long(rng: Random, own: Node, other: Node) -> Pairs:
    if isinstance(own, list) and own:
        return [(None, own * rng.choice((2, 5, 60)))]
    if not isinstance(own, str):
        return _number(rng, own, other)
    return [(None, Raw('"' + str(own)[:50].replace('"', "").replace("\\", "") * rng.choice((2, 500)) + '"'))]


CHANGES: tuple[Callable[[Random, Node, Node], Pairs], ...] = (
    _value, _number, _gone, _twice, _renamed, _swapped, _wrapped, _long,
)  # fmt: skip
WEIGHTS = (3, 8, 2, 1, 1, 2, 1, 1)

__all__ = ["mutated", "text", "tree"]
