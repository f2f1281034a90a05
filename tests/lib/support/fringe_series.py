"""Rows that moves of a mirror join, for tests of fringe counting."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from support.recordings import rows_of
from truepose.arrays import Array
from truepose.identification.recording.recording import Recording


def joined_rows(
    poses: Sequence[int], origins: Sequence[int], q: ArrayLike, change: Array, time: ArrayLike | None = None
) -> Recording:
    """n rows of these poses, each measured from the row ``origins`` (n,), with changes (n,), mm, and readings q (n,)."""
    return rows_of(
        np.array(q, dtype=float)[:, None],
        observations={"dL": change},
        time=None if time is None else np.array(time),
        files=("rows.csv",),
        pose=np.array(poses),
        from_row=np.array(origins),
    )
