"""What a line is said to be: by the gear that the file states, by lines of an encoder, by a ratio that lines share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support.sensor_bench import ARM, HEAD
from truepose.identification.diagnosis.findings import common_ratio, line_words
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine


def machine(folder: Path, ratio: str = "") -> Machine:
    path = folder / "arm.yaml"
    text = HEAD + ARM.replace("{name: q3, kind: revolute,", f"{{name: q3, kind: revolute,{ratio}")
    path.write_text(text, encoding="utf-8")
    return load_machine(path)


def said(of: Machine, order: float, lines: tuple[float, ...] = ()) -> str:
    effect = effects.get("transmission-error", "test")()
    return line_words(of, PlacedEffect.at(effect, of, ("q3",), {"order": order}), lines or (order,))


@pytest.mark.parametrize(
    ("order", "says"),
    [(121.0, "1 a turn of its motor"), (242.0, "2 a turn of its motor"), (243.0, "2 a turn of its motor")],
)
def test_multiples_of_a_stated_gear_are_turns_of_its_motor(order: float, says: str, tmp_path: Path) -> None:
    assert said(machine(tmp_path, " gear_ratio: 121,"), order).endswith(f"of q3: {says}.")
    assert "motor" not in said(machine(tmp_path), order)


def test_a_stated_gear_leaves_no_ratio_to_be_found(tmp_path: Path) -> None:
    lines = (404.0, 1010.0, 2020.0)
    assert "5 of 202, a ratio that several lines share" in said(machine(tmp_path), 1010.0, lines)
    assert said(machine(tmp_path, " gear_ratio: 121,"), 1010.0, lines).endswith("1010 cycles a turn of q3.")


@pytest.mark.parametrize(
    ("order", "power"), [(256.0, 8), (255.0, 8), (257.0, 8), (128.0, 7), (258.0, None), (200.0, None)]
)
def test_powers_of_two_are_lines_of_an_encoder_to_an_order(
    order: float, power: int | None, tmp_path: Path
) -> None:
    words = said(machine(tmp_path), order)
    assert words.startswith(f"A line at {order:g} cycles a turn of q3")
    assert (f"2^{power}, as the lines of an encoder" in words) if power else "encoder" not in words


def test_low_orders_are_no_lines(tmp_path: Path) -> None:
    assert [said(machine(tmp_path), order) for order in (1.0, 2.0)] == ["", ""]


@pytest.mark.parametrize("count", [3, 6, 12])
def test_lines_that_share_nothing_share_a_ratio_in_one_case_of_twenty_at_most(count: int) -> None:
    """Of 581 ratios one is met by chance much sooner than a stated one: 12 lines did so in six cases of seven."""
    rng = np.random.default_rng(count)
    found = [common_ratio(rng.integers(30, 3000, count).astype(float).tolist()) > 0.0 for _ in range(200)]
    assert np.mean(found) < 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / 200)


@pytest.mark.parametrize("ratio", [50.5, 100.5, 101.0, 160.5, 319.5])
def test_ratios_in_halves_are_found_too(ratio: float) -> None:
    lines = [round(times * ratio) for times in (3, 5, 8, 11, 14, 17)]
    assert common_ratio(lines) == pytest.approx(ratio, abs=0.26)


def test_two_lines_or_a_ratio_beyond_those_of_gears_share_nothing() -> None:
    assert common_ratio([404.0, 1010.0]) == 0.0
    assert common_ratio([]) == 0.0
    assert common_ratio([700.0, 1423.0, 2129.0]) == 0.0


@pytest.mark.parametrize(
    ("ratio", "found"), [(29.0, 0.0), (29.5, 0.0), (30.0, 30.0), (320.0, 320.0), (330.0, 165.0)]
)
def test_ratios_are_those_of_strain_wave_gears(ratio: float, found: float) -> None:
    """From 30 to 320; of a larger one the half is told, of which its multiples are multiples."""
    assert common_ratio([times * ratio for times in (3, 5, 7, 11, 13)]) == found


def test_what_is_no_line_shares_no_ratio() -> None:
    """Orders of the catalogue, and powers of two, which are those of encoders."""
    assert common_ratio([30.0, 15.0, 7.0]) == 0.0
    assert common_ratio([128.0, 256.0, 512.0, 1024.0]) == 0.0
    assert common_ratio([404.0, 1010.0, 2020.0]) == common_ratio([404.0, 1010.0, 2020.0, 2048.0, 20.0])
