"""What counts as a change of a committed diagnosis: probabilities beyond a tolerance, families, halves, sets."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

from support.golden_diagnoses import PROBABILITY, changes, summary
from support.reports import arm, synthetic
from truepose.identification.report.results import diagnosis_json


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder: Path = tmp_path_factory.mktemp("golden")
    out = dict(diagnosis_json(synthetic(arm(folder))))
    for quantity in out["findings"][0]["parameters"].values():
        quantity["std"] = quantity["std"] or 1e-5  # one is not known there
    return out


def test_the_same_document_has_not_changed_in_whatever_order_its_sets_stand(document: dict[str, Any]) -> None:
    kept = summary(document)
    assert changes(kept, kept) == []
    turned = copy.deepcopy(document)
    turned["sets"].reverse()
    for one in turned["sets"]:
        one["effects"].reverse()
    turned["inclusion"].reverse()
    assert summary(turned) == kept
    assert kept["sets"] == {
        "empirical@q2 & transmission-error@q1": 0.3,
        "transmission-error@q1": 0.6,
    }  # what is less probable than a fiftieth is not kept


def moved(document: dict[str, Any], by: float) -> dict[str, Any]:
    """Every probability of the posterior, by so much."""
    out = copy.deepcopy(document)
    out["sets"][0]["probability"] += by
    out["inclusion"][0]["probability"] += by
    out["findings"][0]["replication"]["halves"][1] += by
    return out


@pytest.mark.parametrize(("share", "count"), [(0.9, 0), (1.2, 3)])
def test_probabilities_may_move_a_little(document: dict[str, Any], share: float, count: int) -> None:
    """A set's, an effect's, a half's."""
    said = changes(summary(document), summary(moved(document, -share * PROBABILITY)))
    assert len(said) == count
    if said:
        assert said[0].startswith("transmission-error@q1: the halves said")
        assert said[1].startswith("set transmission-error@q1: the probability was 0.600")
        assert said[2].startswith("effect transmission-error@q1: the probability was 0.930")


def test_families_and_halves_that_no_longer_agree_are_changes(document: dict[str, Any]) -> None:
    other = copy.deepcopy(document)
    other["findings"][0]["family"] = "transmission-error"
    other["findings"][0]["replication"]["agree"] = False
    said = changes(summary(document), summary(other))
    assert len(said) == 2 and "family was null" in said[0] and '"agree": false' in said[1]
    gone = copy.deepcopy(document)
    gone["findings"][0]["replication"] = None
    assert len(changes(summary(document), summary(gone))) == 1
    # what was committed before there were such keys differs by them alone
    old = summary(document)
    for finding in old["findings"].values():
        del finding["family"], finding["replication"]
    assert all("halves" in line for line in changes(old, summary(document)))
