"""Measure generated C on a controller: ``measure`` compiles, links, runs and sums up.

``toolchain`` says with what, and ``missing`` what lacks for it.
"""

from __future__ import annotations

import re
import statistics
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truepose.codegen.leaves.embedded.program import Compiler, Sizes, Source, build, linked_sizes, read_source
from truepose.codegen.leaves.embedded.toolchain import (
    Observation,
    Target,
    Toolchain,
    observe,
    required,
    target_for,
)
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


OPTIMISATIONS = ("-O2", "-Os")
_CODES = 5


@dataclass(frozen=True)
class Cost:
    """What one function took over the test vectors.

    codes               how many calls returned 0, 1, 2, 3, 4
    instructions        executed by a call, the mean
    median, most        the same: half of the calls take fewer; the longest
    usual_stack, stack  bytes below the caller's frame: the median, and of the call that went deepest
    position, rotation  largest distance (mm) and angle (rad) from the pose to be met; NaN where any was NaN
    """

    codes: tuple[int, ...]
    instructions: float
    median: float
    most: int
    usual_stack: int
    stack: int
    position: float
    rotation: float


@dataclass(frozen=True)
class Measurement:
    """Generated C on one target, compiled in one way.

    object          NAME_kin.o
    linked_ik,      a program that calls the inverse alone, or forward kinematics alone, with what these need of the
    linked_fk       C library; bytes
    chain_ik,       the functions of NAME_kin.c that together reserve most stack below the inverse, or below forward
    chain_fk        kinematics, these included
    fk              at the joints of each vector
    warm, cold      the inverse from 1 deg (lengths: 0.5 % of the vectors' span) aside, and from another vector's joints; no
                    cold one where it was not generated
    jac, compensate at the joints of each vector; ``position`` is the norm of what they return
    state           an update of NAME_state at each vector; None without one. state_object: NAME_state.o
    refused         calls that must be refused: NaN in joints, guess or pose, no rotation, a pose out of reach (``far``)
    """

    name: str
    target: Target
    optimisation: str
    compiler: str
    emulator: str
    vectors: int
    object: Sizes
    linked_ik: Sizes
    linked_fk: Sizes
    chain_ik: Chain
    chain_fk: Chain
    fk: Cost
    warm: Cost
    cold: Cost | None
    jac: Cost
    compensate: Cost
    refused: tuple[Observation, ...]
    state: Cost | None = None
    state_object: Sizes | None = None

    @property
    def longest(self) -> int:
        """Instructions of the longest inverse seen: ``NAME_MAX_ITER`` evaluations for a pose out of reach."""
        return max(self.inverse.most, *(seen.instructions for seen in self.refused))

    @property
    def inverse(self) -> Cost:
        """The inverse from afar; from nearby where that is all there is."""
        return self.cold or self.warm

    @property
    def solved(self) -> bool:
        """Whether every call at a test vector returned 0, and none that must be refused did."""
        costs = (self.fk, self.warm, self.inverse, self.jac, self.compensate)
        return all(cost.codes[0] == self.vectors for cost in costs) and all(
            seen.code != 0 and seen.kept for seen in self.refused
        )


def measure(
    directory: Path,
    name: str | None = None,
    target: Target | None = None,
    optimisation: str = "-O2",
    tools: Toolchain | None = None,
) -> Measurement:
    """Measure the C that ``generate`` wrote into ``directory``; nothing is written there.

    ``name``: the machine, by default the one found. ``target``: by default the one whose floating point unit
    computes with the C's type of number.

    Raises InputError where the toolchain is missing, where the C does not compile without a warning, or where the
    target computes with another type.
    """
    source = read_source(Path(directory), name)
    target = target or target_for(source.real)
    if target.real != source.real:
        raise InputError(f"{directory}: found C in {source.real}, expected {target.real} for {target.title}")
    with tempfile.TemporaryDirectory(prefix="truepose-") as folder:
        return _measured(source, Compiler(tools or required(), target, optimisation), Path(folder))


def _measured(source: Source, compiler: Compiler, where: Path) -> Measurement:
    """Compile and run the test program in a folder, and sum up what was seen of its calls."""
    seen = observe(build(source, compiler, where), compiler.target, compiler.tools)
    frames = read_frames(where / "kin.ci")
    linked_ik, linked_fk = linked_sizes(source, compiler, where)
    return Measurement(
        name=source.name,
        target=compiler.target,
        optimisation=compiler.optimisation,
        compiler=compiler.tools.compiler,
        emulator=compiler.tools.emulator,
        vectors=len(source.joints),
        object=compiler.sizes(where / "kin.o"),
        linked_ik=linked_ik,
        linked_fk=linked_fk,
        chain_ik=frames.deepest(f"{source.name}_ik"),
        chain_fk=frames.deepest(f"{source.name}_fk"),
        fk=_cost(seen, "fk"),
        warm=_cost(seen, "warm"),
        cold=_cost_if_any(seen, "cold"),
        jac=_cost(seen, "jac"),
        compensate=_cost(seen, "compensate"),
        refused=tuple(call for call in seen if call.what.startswith(("nan-", "far", "skewed"))),
        state=_cost_if_any(seen, "state"),
        state_object=compiler.sizes(where / "state.o") if source.remembers else None,
    )


def _cost_if_any(seen: Sequence[Observation], what: str) -> Cost | None:
    return _cost(seen, what) if any(call.what == what for call in seen) else None


def _cost(seen: Sequence[Observation], what: str) -> Cost:
    calls = [call for call in seen if call.what == what]
    codes, counts = [call.code for call in calls], [call.instructions for call in calls]
    return Cost(
        codes=tuple(codes.count(code) for code in range(_CODES)),
        instructions=statistics.fmean(counts),
        median=statistics.median(counts),
        most=max(counts),
        usual_stack=statistics.median_high(call.stack for call in calls),
        stack=max(call.stack for call in calls),
        position=float(np.max([call.position for call in calls])),
        rotation=float(np.max([call.rotation for call in calls])),
    )
