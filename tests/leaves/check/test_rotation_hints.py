"""A rotation in another form than rx ry rz: the error says which import writes them, and that import's recording fits."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from support.checked_arm import document, recorded, written
from support.command import input_error, run
from truepose.identification.leaves.check.run import check_files

VECTOR = ["rx", "ry", "rz"]


def in_form(rows: pd.DataFrame, names: tuple[str, ...]) -> pd.DataFrame:
    """Return the rows with their rotation as a quaternion, scalar last, or as roll, pitch and yaw under other names."""
    turned = Rotation.from_rotvec(rows[VECTOR].to_numpy(), degrees=True)
    values = turned.as_quat() if len(names) == 4 else turned.as_euler("ZYX", degrees=True)[:, ::-1]
    return pd.concat([rows.drop(columns=VECTOR), pd.DataFrame(values, columns=list(names))], axis=1)


@pytest.mark.parametrize(
    "names",
    [("qx", "qy", "qz", "qw"), ("roll", "pitch", "yaw"), ("C", "B", "A"), ("W", "P", "R")],
    ids="".join,
)
def test_what_the_error_says_to_do_gives_a_recording_that_fits(
    names: tuple[str, ...], tmp_path: Path
) -> None:
    rows = recorded()
    assert not np.allclose(rows[VECTOR], 0.0)
    machine, table = written(tmp_path, document(), in_form(rows, names))
    with input_error("missing column 'rx'") as refused:
        check_files(machine, [table])
    found = re.search(r"`truepose import([^`]*)`", str(refused.value))
    assert found is not None, str(refused.value)
    run("import", table, *shlex.split(found[1]), "-o", tmp_path / "own.csv")
    assert check_files(machine, [tmp_path / "own.csv"])[0].verdict == "ok"
