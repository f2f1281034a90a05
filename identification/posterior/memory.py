"""What was worked out and may be asked for again, within a limit of memory."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from typing import Generic, TypeVar

REMEMBERED = 80_000_000
"""Bytes of values that take much memory which are kept."""
Value = TypeVar("Value")


class Memory(Generic[Value]):
    """The latest so many values, and of those that take much memory no more than fit into ``REMEMBERED``."""

    def __init__(self, limit: int, size: Callable[[Value], int] | None = None) -> None:
        self._limit, self._values, self._size = max(limit, 4), OrderedDict[Hashable, Value](), size
        self._sizes, self._total = dict[Hashable, int](), 0

    def clear(self) -> None:
        """Forget all."""
        self._values.clear()
        self._sizes.clear()
        self._total = 0

    def get_or(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """The value of a key, made where it is not there."""
        return self.get_all([key], lambda _: [make()])[0]

    def get_all(
        self, keys: Sequence[Hashable], make: Callable[[Sequence[int]], Sequence[Value]]
    ) -> list[Value]:
        """The values of keys; those that are not there, by their places, are made at once."""
        new = [k for k, key in enumerate(keys) if key not in self._values]
        made = dict(zip(new, make(new), strict=True)) if new else {}
        found = [made[k] if k in made else self._values[key] for k, key in enumerate(keys)]
        for key, value in zip(keys, found, strict=True):
            self._values[key] = value
            self._values.move_to_end(key)
            self._measure(key, value)
        while len(self._values) > self._limit or self._total > REMEMBERED:
            if len(self._values) <= len(keys):
                break  # what was asked for stays, however large
            self._let_go()
        return found

    def _measure(self, key: Hashable, value: Value) -> None:
        """Values grow while they are used: what one takes is asked anew whenever it is."""
        if self._size is not None:
            size = self._size(value)
            self._total += size - self._sizes.get(key, 0)
            self._sizes[key] = size

    def _let_go(self) -> None:
        key, _ = self._values.popitem(last=False)
        self._total -= self._sizes.pop(key, 0)
