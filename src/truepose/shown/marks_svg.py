"""Marks of a chart as pieces of a path: each begins with one move, so that the k-th move is the k-th mark."""

from __future__ import annotations

from collections.abc import Callable

SIZE = {"dot": 4.5, "stroke": 2.0, "ring": 1.3, "tick": 1.2, "diamond": 1.0}
"""Width of the stroke that draws a mark, pixels."""
POINTS: dict[str, Callable[[float, float], str]] = {
    "dot": lambda x, y: f"M{x:.1f} {y:.1f}h0",
    "stroke": lambda x, y: f"M{x - 3:.1f} {y:.1f}h6",
    "tick": lambda x, y: f"M{x:.1f} {y:.1f}v-7",
    "ring": lambda x, y: f"M{x - 2.5:.1f} {y:.1f}a2.5 2.5 0 1 0 5 0a2.5 2.5 0 1 0-5 0",
    "diamond": lambda x, y: f"M{x:.1f} {y - 4.5:.1f}l4.5 4.5l-4.5 4.5l-4.5-4.5z",
}
"""Path of a mark at a place, pixels."""
