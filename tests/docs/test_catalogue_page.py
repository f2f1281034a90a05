"""The page of the catalogue is what the effects say, and every effect has a drawing."""

from __future__ import annotations

import re

import numpy as np
import pytest

import catalogue_canvas
import catalogue_law
import catalogue_page
from catalogue_drawings import DRAWINGS, FOLDER, drawing, path_of
from truepose.models.machine.effect import effects

NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
POINT = re.compile(r"[ML](-?\d+\.\d) (-?\d+\.\d)")


def test_the_page_is_up_to_date() -> None:
    """Run ``python docs/catalogue_page.py`` after an effect was added or described anew."""
    assert catalogue_page.page() == catalogue_page.PAGE.read_text(encoding="utf-8")


def test_every_effect_has_a_drawing_and_a_group_and_none_is_left_over() -> None:
    assert set(DRAWINGS) == set(catalogue_page.listed()) == {path.stem for path in FOLDER.glob("*.svg")}
    grouped = [slug for group in catalogue_page.GROUPS.values() for slug in group]
    assert sorted(grouped) == sorted(catalogue_page.listed())


@pytest.mark.parametrize("slug", catalogue_page.listed())
def test_the_drawing_is_up_to_date_and_within_its_paper(slug: str) -> None:
    """Run ``python docs/catalogue_page.py``. Numbers may differ by a rounding."""
    made, stored = drawing(slug, effects.get(slug, "").title), path_of(slug).read_text(encoding="utf-8")
    assert NUMBER.sub("#", made) == NUMBER.sub("#", stored)
    one, two = ([float(n) for n in NUMBER.findall(text)] for text in (made, stored))
    assert np.allclose(one, two, rtol=0.0, atol=0.11)
    points = np.array([[float(x), float(y)] for x, y in POINT.findall(made)])
    assert np.all(points >= 0.0) and np.all(points <= [catalogue_canvas.WIDTH, catalogue_canvas.HEIGHT])


def test_curves_come_from_the_effects_own_formula() -> None:
    q = np.linspace(-1.0, 1.0, 5)
    assert np.allclose(catalogue_law.law("actuator-scale", "x", {"s": 0.1}, {"x": q}), 0.1 * q)
    play = catalogue_law.law("backlash", "x", {"b": 0.2}, {"approach.x": np.array([-1.0, 0.0, 1.0])})
    assert np.allclose(play, [0.1, 0.0, -0.1])


def test_what_an_effect_needs_is_what_it_reads() -> None:
    assert catalogue_page.needs("actuator-scale") == ""
    assert catalogue_page.needs("backlash") == "`approach.<joint>` or rows in the order measured"
    assert catalogue_page.needs("friction-hysteresis") == "`approach.<joint>`, rows in the order measured"
    assert catalogue_page.needs("early-reading") == "rows in the order measured"
    assert catalogue_page.needs("thermal-expansion") == "`temperature.<place>`, `time`"
    assert catalogue_page.needs("joint-compliance").startswith("`gravity`, `masses`")
