"""Rows that moves of a mirror join, for tests of fringe counting."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose.identification.recording.recording import Recording

Array = NDArray[np.float64]


def joined_rows(
    poses: Sequence[int], origins: Sequence[int], q: ArrayLike, change: Array, time: ArrayLike | None = None
) -> Recording:
    """n rows of these poses, each measured from the row ``origins`` (n,), with changes (n,), mm, and readings q (n,)."""
    n = len(poses)
    whole = np.zeros(n, dtype=np.int64)
    return Recording(
        joints=("q1",),
        q=np.array(q, dtype=float)[:, None],
        observations={"dL": change},
        labels={},
        drivers={},
        time=None if time is None else np.array(time),
        files=("rows.csv",),
        source_file=whole,
        source_row=np.arange(1, n + 1),
        session=whole + 1,
        session_recorded=whole == 0,
        validation=whole == 1,
        pose=np.array(poses),
        from_row=np.array(origins),
    )
