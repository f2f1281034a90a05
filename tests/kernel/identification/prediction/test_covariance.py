"""Covariances as a machine file holds them: what is written is read, parts and sums are those of whole matrices."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.prediction.covariance import UNSEEN, Covariance

NAMES = ("a", "b", "c", "d")
SCALE = np.array([1.0, 0.01, 10.0, 2.0])


def whole(of: Covariance) -> Array:
    return np.asarray(of.factor @ of.factor.T)


def drawn(names: tuple[str, ...] = NAMES, unknown: int = 1, seed: int = 0) -> Covariance:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(len(names), len(names) - unknown))
    return Covariance.of(names, np.resize(SCALE, len(names)), root, rng.normal(size=(unknown, len(names))))


@pytest.mark.parametrize("columns", [2, 4, 9])
def test_the_factor_is_of_the_whole_covariance_in_its_units(columns: int) -> None:
    root = np.random.default_rng(columns).normal(size=(4, columns))
    unknown = np.array([[1.0, 1.0, 0.0, 0.0]])
    found = Covariance.of(NAMES, SCALE, root, unknown)
    np.testing.assert_allclose(whole(found), (root @ root.T) * np.outer(SCALE, SCALE), rtol=1e-10, atol=1e-14)
    np.testing.assert_array_equal(found.factor, np.tril(found.factor))
    np.testing.assert_allclose(found.unknown, unknown * SCALE)


def test_what_is_written_is_read() -> None:
    own = {"sensor.position": (0.02, "mm"), "sensor.rotation": (1e-4, "rad")}
    made = replace(drawn(), unexplained=own, seen={"q1": (-1.0, 2.0), "payload": (3.0, 3.0)})
    read = Covariance.read(made.document(), "here")
    np.testing.assert_array_equal(read.factor, made.factor)
    np.testing.assert_array_equal(read.unknown, made.unknown)
    assert (read.names, read.unexplained, read.seen) == (made.names, made.unexplained, made.seen)
    none = Covariance.read({"names": [], "factor": []}, "here")  # every parameter fixed
    assert none.names == () and none.unknown.shape == none.factor.shape == (0, 0)
    bare = Covariance.of_tolerances(NAMES, np.ones(4)).document()
    assert set(bare) == {"form", "names", "factor"} and "packed" not in bare["form"]
    assert [len(row.split()) for row in bare["factor"]] == [1, 2, 3, 4]


def test_some_names_are_a_part_of_the_whole() -> None:
    made = replace(drawn(), unexplained={"s.position": (1.0, "mm")}, seen={"q1": (0.0, 1.0)})
    made = replace(made, unknown=np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 1.0, 0.0]]))
    part = made.of_names(["d", "b"])
    np.testing.assert_allclose(whole(part), whole(made)[np.ix_([3, 1], [3, 1])], rtol=1e-9, atol=1e-14)
    np.testing.assert_array_equal(part.unknown, [[0.0, 1.0]])
    assert part.unexplained == made.unexplained and part.seen == made.seen


def test_two_stand_beside_each_other_as_independent() -> None:
    one = replace(drawn(), unexplained={"s.position": (1.0, "mm")}, seen={"q1": (0.0, 1.0)})
    other = replace(drawn(("e", "f", "g"), 2, seed=1), seen={"q2": (5.0, 6.0)})
    both = one.beside(other)
    assert (
        both.names == (*NAMES, "e", "f", "g")
        and both.seen == other.seen
        and both.unexplained == one.unexplained
    )
    np.testing.assert_allclose(whole(both)[:4, :4], whole(one))
    np.testing.assert_allclose(whole(both)[4:, 4:], whole(other))
    assert not whole(both)[:4, 4:].any()
    np.testing.assert_allclose(both.unknown[:1, :4], one.unknown)
    np.testing.assert_allclose(both.unknown[1:, 4:], other.unknown)
    assert both.unknown.shape == (3, 7) and not both.unknown[:1, 4:].any() and not both.unknown[1:, :4].any()


def test_a_quantity_has_the_sigma_of_the_whole_covariance() -> None:
    made, jacobian = drawn(unknown=0), np.random.default_rng(3).normal(size=(5, 2, 4))
    expected = np.sqrt(np.einsum("nki,ij,nkj->nk", jacobian, whole(made), jacobian))
    np.testing.assert_allclose(made.std(jacobian, SCALE), expected)


def test_an_unknown_direction_shows_unless_it_is_rounding() -> None:
    """In steps of each entry, whatever their units and however long the direction is written."""
    for length in (1.0, 1e6):
        made = replace(drawn(unknown=0), unknown=length * np.array([[1.0, -0.01, 0.0, 0.0]]))  # a step each
        along, across = np.array([1.0, 0.0, 0.0, 0.0]), np.array([1.0, 100.0, 0.0, 0.0])
        assert np.isinf(made.std(along, SCALE))
        assert np.isfinite(made.std(across, SCALE))
        for share, known in ((0.5, True), (2.0, False)):
            # as much of the direction, whose length is the root of two, as is still rounding
            faint = across + share * UNSEEN * np.sqrt(2.0) * np.sqrt(2.0) * along
            assert np.isfinite(made.std(faint, SCALE)) == known


def changed(**sections: Any) -> dict[str, Any]:
    made = replace(drawn(("a", "b"), 0), unexplained={"s": (1.0, "mm")}, seen={"q": (0.0, 1.0)})
    return {**made.document(), **sections}


@pytest.mark.parametrize(
    ("section", "says"),
    [
        (changed(factor=["1"]), "1 rows of factor, expected 2"),
        (changed(factor=["1", "nan 2"]), "expected 2 of finite"),
        (changed(factor=["1", "1 2", "1 2 3"]), "cannot be read"),
        (changed(factor={"a": 1}), "cannot be read"),
        (changed(factor="AAAA"), "cannot be read|rows of factor"),
        (changed(names=3), "cannot be read"),
        (changed(unknown=["1 x"]), "cannot be read"),
        (changed(unknown=["1 2 3"]), "cannot be read"),
        (changed(unexplained={"s": {"value": -1.0, "unit": "mm"}}), "unexplained.s: found -1.0 mm"),
        (changed(unexplained={"s": {"value": float("inf"), "unit": "mm"}}), "unexplained.s: found inf mm"),
        (changed(unexplained={"s": {"value": 1.0, "unit": "deg"}}), "unexplained.s: found 1.0 deg"),
        (changed(seen={"q": [2.0, 1.0]}), "is no range"),
        (changed(seen={"q": [0.0, float("inf")]}), "is no range"),
        ({"names": ["a"]}, "cannot be read"),
    ],
)  # fmt: skip
def test_what_is_no_covariance_is_refused(section: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=f"^here.*{says}"):
        Covariance.read(section, "here")
