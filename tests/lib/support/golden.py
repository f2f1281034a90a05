"""What differs between two JSON documents, a sentence each, where numbers may move a little."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

Where = tuple[str, ...]
Same = Callable[[Where, Any, Any], bool]
"""Whether two values count as the same, by the keys that lead to them; what is missing is None."""


def differences(old: Any, new: Any, same: Same, where: Where = ()) -> Iterator[str]:
    """Yield a sentence on each value that is not as it was."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys([*old, *new]):
            yield from differences(old.get(key), new.get(key), same, (*where, key))
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for k, pair in enumerate(zip(old, new, strict=True)):
            yield from differences(*pair, same, (*where, str(k)))
    elif not same(where, old, new):
        yield f"{' / '.join(where)} was {old} and is {new}"
