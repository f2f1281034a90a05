"""JSON of a result: plain, in the order given, indented by two, and null for what is no number."""

from __future__ import annotations

import json

import numpy as np
import pytest

from truepose.identification.report.json_text import finite, json_text

NAN, INF = float("nan"), float("inf")


def test_a_document_reads_as_it_was_given() -> None:
    text = json_text({"b": [1, 2.5], "a": {"µ": None, "no": True}})
    assert text == ('{\n  "b": [\n    1,\n    2.5\n  ],\n  "a": {\n    "µ": null,\n    "no": true\n  }\n}\n')
    third = 1.0 / 3.0
    assert json.loads(json_text({"x": third}))["x"] == third


@pytest.mark.parametrize(
    ("value", "plain"),
    [
        (NAN, None), (INF, None), (-INF, None), (np.float64(NAN), None), (np.float64(0.5), 0.5), (np.int64(3), 3),
        (np.bool_(True), True), ((1.0, NAN), [1.0, None]), ([(), "x"], [[], "x"]), ({1: {"a": INF}}, {"1": {"a": None}}),
        (False, False), (None, None), (7, 7),
    ],
)  # fmt: skip
def test_what_is_no_finite_number_is_null_at_any_depth(value: object, plain: object) -> None:
    found = finite(value)
    assert found == plain and type(found) is type(plain)
