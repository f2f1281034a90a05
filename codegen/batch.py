"""Evaluate a CasADi function over many rows at once, in chunks, without copying through DM.

Use ``BatchFunction`` where the same expressions are needed for every row of a recording: inputs are
(n, size) arrays (or one (size,) vector shared by all rows), outputs (n, rows, columns) arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CHUNK = 64


class BatchFunction:
    """Dense SX outputs of SX vector inputs, mapped over rows by CasADi's virtual machine."""

    def __init__(self, name: str, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> None:
        dense = [ca.densify(output) for output in outputs]
        self._function = ca.Function(name, list(inputs), dense, {"allow_free": False})
        self._shapes = [output.shape for output in dense]
        self._sizes = [int(item.numel()) for item in inputs]
        self._mapped: dict[int, ca.Function] = {}

    @property
    def instructions(self) -> int:
        """Scalar operations of one row."""
        return int(self._function.n_instructions())

    def __call__(self, *inputs: Array) -> tuple[Array, ...]:
        """Outputs for n rows; n is that of the first two-dimensional input."""
        rows = next((len(a) for a in inputs if np.ndim(a) == 2), 1)
        results = tuple(np.empty((rows, columns, height)) for height, columns in self._shapes)
        prepared = [
            np.ascontiguousarray(np.broadcast_to(a, (rows, size)), dtype=float)
            for a, size in zip(inputs, self._sizes, strict=True)
        ]
        for start in range(0, rows, CHUNK):
            part = slice(start, min(start + CHUNK, rows))
            self._evaluate([a[part] for a in prepared], [result[part] for result in results])
        return tuple(result.transpose(0, 2, 1) for result in results)

    def _evaluate(self, inputs: Sequence[Array], outputs: Sequence[Array]) -> None:
        rows = len(outputs[0])
        if rows not in self._mapped:
            self._mapped[rows] = self._function if rows == 1 else self._function.map(rows)
        buffer: Any  # casadi's stubs misstate what it takes
        buffer, evaluate = self._mapped[rows].buffer()
        for k, item in enumerate(inputs):
            if item.size:
                buffer.set_arg(k, _memory(item))
        for k, item in enumerate(outputs):
            if item.size:
                buffer.set_res(k, _memory(item))
        evaluate()


def _memory(item: Array) -> memoryview[float]:
    return memoryview(item.data).cast("B").cast("d")
