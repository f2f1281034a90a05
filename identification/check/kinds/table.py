"""A table of Denavit and Hartenberg's constants typed in under another convention than it was made for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from truepose.identification.check.pair import Pair
from truepose.identification.check.rig import Rig, Scene
from truepose.identification.check.slip import Slip

_LAYOUTS = (
    ("standard", {"a": "d", "d": "r"}, "a data sheet's standard table, a typed as d and d as r"),
    ("standard", {"a": "r", "d": "d"}, "a data sheet's standard table, d typed as d and a as r"),
    ("modified", {"a": "r", "d": "d"}, "a modified table, d typed as d and a as r"),
)
"""Which convention the rows are of, where its a and d were typed, and how to say it."""


def conventions(rig: Rig, scene: Scene) -> Iterator[Slip]:
    """The rows of a serial chain as those of another convention."""
    file = rig.machine.file
    if file is None or file.mechanism.get("type") != "serial":
        return
    names = [row["name"] for row in file.mechanism["joints"]]
    at = {f: np.array([rig.names.index(f"{n}.{f}") for n in names]) for f in ("alpha", "d", "theta", "r")}
    if file.mechanism.get("convention", "khalil") not in ("khalil", None):
        yield Slip(
            "dh-convention",
            ("mechanism.convention",),
            "a modified table (a and alpha of the joint before), typed as a standard one",
            "state 'convention: modified'",
            partial(_one_back, at),
            lambda pair: pair.with_field(("mechanism", "convention"), "modified"),
        )
        return
    for convention, typed, words in _LAYOUTS:
        yield Slip(
            "dh-convention",
            ("mechanism.joints",),
            f"the joints' rows as {words}",
            f"state 'convention: {convention}' with fields a, alpha, d, theta",
            partial(_as_table, at, convention, typed),
            partial(_mend, convention, typed),
        )


def _as_table(at: Mapping[str, Any], convention: str, typed: Mapping[str, str], scene: Scene) -> Scene:
    """The chain's constants as the table means them; what a standard table has behind its last joint is the tool's."""
    p = scene.p.copy()
    a, d, alpha = (scene.p[at[field]] for field in (typed["a"], typed["d"], "alpha"))
    p[at["r"]] = d
    if convention == "standard":
        a, alpha = np.concatenate([[0.0], a[:-1]]), np.concatenate([[0.0], alpha[:-1]])
    p[at["d"]], p[at["alpha"]] = a, alpha
    return replace(scene, p=p)


def _one_back(at: Mapping[str, Any], scene: Scene) -> Scene:
    """A standard table's constants, one joint back: those that a modified table has in the same rows."""
    p = scene.p.copy()
    for field in ("d", "alpha"):
        p[at[field]] = np.concatenate([scene.p[at[field]][1:], [0.0]])
    return replace(scene, p=p)


def _mend(convention: str, typed: Mapping[str, str], pair: Pair) -> Pair:
    rows: Sequence[Mapping[str, Any]] = pair.get(("mechanism", "joints")) or ()
    called = {typed["a"]: "a", typed["d"]: "d"}
    mended = [{called.get(key, key): value for key, value in row.items() if key != "beta"} for row in rows]
    return pair.with_field(("mechanism", "joints"), mended).with_field(
        ("mechanism", "convention"), convention
    )


__all__ = ["conventions"]
