"""The most evaluations of the model that an inverse takes: the C compiled again with smaller limits until poses fail.

``NAME_MAX_ITER`` bounds the evaluations of one inverse, and nothing else depends on it: a pose that a limit of k
leaves unsolved needs more than k.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from . import generated
from .problems import Problems, anywhere, save
from .study import Bench, Options


def most(b: Bench, options: Options) -> int:
    """The evaluations of the worst pose of the random ones that are solved at all, by bisection of the limit."""
    problems = anywhere(b.arm, options.poses)
    low, high = 0, _limit(b)
    hard = _chosen(problems, _solved(b, options, problems, high))
    while high - low > 1:
        middle = (low + high) // 2
        solved = _solved(b, options, hard, middle)
        low, high = (low, middle) if solved.all() else (middle, high)
        hard = hard if solved.all() else _chosen(hard, ~solved)
    return high


def _chosen(problems: Problems, which: NDArray[np.bool_]) -> Problems:
    return Problems(problems.targets[which], problems.guesses[which])


def _solved(b: Bench, options: Options, problems: Problems, limit: int) -> NDArray[np.bool_]:
    """(n,) whether each pose is solved within ``limit`` evaluations."""
    source = b.source
    folder = options.folder / f"{source.name}_limited"
    folder.mkdir(exist_ok=True)
    for file in source.folder.glob(f"{source.name}_*.[ch]"):
        (folder / file.name).write_text(file.read_text())
    text = re.sub(rf"(#define {source.name}_MAX_ITER) \d+", rf"\1 {limit}", _header(b))
    (folder / f"{source.name}_kin.h").write_text(text)
    program = generated.build(replace(source, folder=folder), generated.PLAIN)
    files = save(problems, options.folder, f"{source.name}_limited")
    return np.asarray(generated.timed(program, "one", files, 1, options.core).output[:, 0] == 0)


def _limit(b: Bench) -> int:
    found = re.search(rf"#define {b.source.name}_MAX_ITER (\d+)", _header(b))
    if found is None:
        raise RuntimeError(f"{b.source.name}_kin.h: found no {b.source.name}_MAX_ITER, expected one")
    return int(found.group(1))


def _header(b: Bench) -> str:
    return (b.source.folder / f"{b.source.name}_kin.h").read_text()
