"""The stack that compiled C reserves, by the compiler's own account: frames and calls (gcc ``-fcallgraph-info=su``).

Painting (``emulator``) sees what calls wrote, the C library included; this sees what the functions of one file
reserve on their deepest path, whether or not a call went there. It also proves that there is no recursion.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from truepose.errors import InputError

_NODE = re.compile(r'^node: \{ title: "([^"]*)" label: "[^"]*?\\n(\d+) bytes \(([^)]*)\)', re.MULTILINE)
_EDGE = re.compile(r'^edge: \{ sourcename: "([^"]*)" targetname: "([^"]*)"', re.MULTILINE)
_INDIRECT = "__indirect_call"


@dataclass(frozen=True)
class Chain:
    """Functions that call one another, outermost first, with the bytes that each one's frame takes."""

    frames: tuple[tuple[str, int], ...]

    @property
    def size(self) -> int:
        """Bytes of all frames together."""
        return sum(size for _, size in self.frames)


@dataclass(frozen=True)
class Frames:
    """Frames (bytes) and calls of the functions of one file; a function of another file takes no frame here.

    indirect: whether a function is called through a pointer, so that the chains may not be all there are.
    """

    sizes: Mapping[str, int]
    calls: Mapping[str, tuple[str, ...]]
    indirect: bool

    def deepest(self, function: str) -> Chain:
        """The chain of calls from ``function`` that takes most stack.

        Raises InputError where functions call themselves, which has no deepest chain.
        """
        return Chain(tuple((_plain(name), self.sizes[name]) for name in self._deepest(function, ())))

    def _deepest(self, function: str, above: tuple[str, ...]) -> tuple[str, ...]:
        if function in above:
            around = " -> ".join(_plain(name) for name in (*above[above.index(function) :], function))
            raise InputError(f"stack: found recursion {around}, expected none")
        inner = [name for name in self.calls.get(function, ()) if name in self.sizes]
        chains = [self._deepest(name, (*above, function)) for name in inner]
        return (function, *max(chains, key=lambda chain: sum(map(self.sizes.__getitem__, chain)), default=()))


def read_frames(file: Path) -> Frames:
    """Frames of a ``.ci`` file. Raises InputError where a frame's size depends on what happens."""
    text = file.read_text(encoding="utf-8")
    nodes = _NODE.findall(text)
    for name, _, kind in nodes:
        if kind != "static":
            raise InputError(f"{_plain(name)}: found a frame of {kind} size, expected a fixed one")
    calls: dict[str, tuple[str, ...]] = {}
    for source, called in _EDGE.findall(text):
        calls[source] = tuple(dict.fromkeys((*calls.get(source, ()), called)))
    indirect = any(_INDIRECT in called for called in calls.values())
    return Frames({name: int(size) for name, size, _ in nodes}, calls, indirect)


def _plain(title: str) -> str:
    """A function's name as it is written: without its file, and without what the compiler made of it."""
    return title.rpartition(":")[2].partition(".")[0]
