"""JSON of any result: what is no number (NaN, infinity) becomes null; the same result gives the same text."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

Json = dict[str, Any]


def json_text(value: Mapping[str, Any]) -> str:
    """Indented JSON, keys in the order given, floats at full precision."""
    return json.dumps(finite(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def finite(value: Any) -> Any:
    """The same structure in plain types, with null for what is no finite number."""
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if isinstance(value, (str, bool)) or value is None:
        return value
    if hasattr(value, "item"):
        return finite(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def attributes(one: object, *names: str) -> Json:
    """Return some attributes of an object by name, in this order, in plain types."""
    return {name: finite(getattr(one, name)) for name in names}
