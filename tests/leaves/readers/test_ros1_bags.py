"""Bags of ROS 1: the same table as the messages have in ROS 2, and what says other sizes than it has is refused."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from support.guide_bag import write_bag
from support.ros1_bag import as_ros1
from truepose.identification.leaves.readers.bags import read_bag
from truepose.identification.recording.table import table_of

pytest.importorskip("rosbags")
COMPRESSIONS = ("none", "lz4", "bz2")


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("bag"), poses=4)


@pytest.fixture(scope="module", params=COMPRESSIONS)
def older(request: pytest.FixtureRequest, bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return as_ros1(bag, tmp_path_factory.mktemp("ros1") / "run.bag", request.param)


def test_it_is_the_table_of_the_same_messages(bag: Path, older: Path) -> None:
    found, wanted = (table_of("bag", read_bag(path)) for path in (older, bag))
    assert [(c.name, c.unit) for c in found.columns] == [(c.name, c.unit) for c in wanted.columns]
    names = [c.name for c in wanted.columns if c.name not in ("file", "source")]
    pd.testing.assert_frame_equal(
        pd.DataFrame({name: found.numbers(name) for name in names}),
        pd.DataFrame({name: wanted.numbers(name) for name in names}),
    )
