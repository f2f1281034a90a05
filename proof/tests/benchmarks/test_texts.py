"""The study of long texts: every form that it times holds the same rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from many_rows.arm import write
from many_rows.texts import FORMS, plain_text

from truepose.identification.recording.table import Table, read_table


def _read(folder: Path, form: str) -> Table:
    _, recording = write(2500, folder)
    path = folder / "rows.csv"
    path.write_text("".join(map(FORMS[form], plain_text(recording))), encoding="utf-8", newline="")
    return read_table(path)


@pytest.mark.parametrize("form", FORMS)
def test_every_form_holds_the_rows_of_the_arm(form: str, tmp_path: Path) -> None:
    plain, found = _read(tmp_path, "plain"), _read(tmp_path, form)
    assert found.names == plain.names
    for name in plain.names[:-1]:
        np.testing.assert_array_equal(found.numbers(name), plain.numbers(name))
    assert [label[:5] for label in found.texts("note")] == ["stop0"] * 1000 + ["stop1"] * 1000 + [
        "stop2"
    ] * 500
