"""``simulate --effect`` adds what it says: an effect without a value, or with one that it cannot have, is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from support import MACHINES
from truepose.cli import app


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("backlash@q3", "adds nothing as it stands, expected a value of b (rad), such as backlash@q3:b="),
        ("backlash@q3:b=-1[mrad]", "b = -1 mrad, expected a value >= 0"),
        ("transmission-error@q2:orders=9", "a1 (rad), b1 (rad), a2 (rad), b2 (rad), a3 (rad), b3 (rad), such as"),
        ("transmission-error@q2:order=0,a=1[mrad]", "order: 0, expected a number from -10000 to 10000 that is not 0"),
        ("transmission-error@q2:orders=181,a1=1[mrad]", "orders: 181, expected a whole number from 1 to 180"),
        ("transmission-error@q2:orders=1.5,a1=1[mrad]", "orders: 1.5, expected a whole number from 1 to 180"),
        ("transmission-error@q2:ordres=2,a1=1[mrad]", "unknown name 'ordres'; did you mean 'orders'?"),
    ],
)  # fmt: skip
def test_what_adds_nothing_or_cannot_be_is_refused(text: str, told: str, tmp_path: Path) -> None:
    out = tmp_path / "rows.csv"
    words = ["simulate", MACHINES / "serial.yaml", tmp_path / "poses.csv", "--effect", text, "-o", out]
    result = CliRunner().invoke(app, [*map(str, words)])
    assert result.exit_code == 2
    assert told in result.stderr
    assert not out.exists()
