"""Symbolic functions over many rows at once, compiled where that pays: what fits are evaluated with."""
