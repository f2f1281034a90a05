"""Tables without a name for their convention: which one fits the readings."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.checked_arm import Document, document, recorded, written
from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.run import unnamed_table


def nameless(convention: str) -> Document:
    """The arm's table without a name, as the readings were made with it, or with rows one joint on."""
    machine = document()
    del machine["mechanism"]["convention"]
    joints = machine["mechanism"]["joints"]
    if convention == "modified":
        before = [{"a": 0.0, "alpha": 0.0}, *({k: row[k] for k in ("a", "alpha")} for row in joints)]
        machine["mechanism"]["joints"] = [row | old for row, old in zip(joints, before, strict=False)]
    return machine


@pytest.mark.parametrize(
    ("convention", "words"),
    [("standard", "a data sheet's standard table"), ("modified", "a modified table (Craig)")],
)
def test_a_table_without_a_name_is_that_of_which_the_readings_are(
    convention: str, words: str, tmp_path: Path
) -> None:
    path, rows = written(tmp_path, nameless(convention), recorded()[:20])
    pair = Pair.read(path, [rows])
    check = unnamed_table(pair, [rows])
    assert check is not None
    (found,) = check.found
    assert (found.kind, found.where) == ("dh-convention", ("mechanism.joints", "mechanism.convention"))
    assert found.says == f"the joints have a field 'a' and no convention is stated; as {words} they fit best"
    assert found.fix == f"state 'convention: {convention}' beside 'joints'"
    assert (found.verdict, found.before, found.unit, check.rows) == ("wrong", None, "mm", 20)
    # tolerances of the arm: 0.2 mm and 0.05 deg over a metre
    assert found.after is not None and found.after == check.left and 0.1 < found.after < 5.0
    assert found.mend is not None
    assert found.mend(pair).get(("mechanism", "convention")) == convention


@pytest.mark.parametrize(
    "mechanism",
    [{"convention": "standard"}, {"type": "6-ups"}, {"joints": "six"}, {"joints": [{"name": "q1"}]}],
)
def test_other_faults_of_a_file_are_no_matter_of_names(mechanism: Document, tmp_path: Path) -> None:
    machine = nameless("standard")
    machine["mechanism"] |= mechanism
    path, rows = written(tmp_path, machine, recorded()[:20])
    assert unnamed_table(Pair.read(path, [rows]), [rows]) is None
