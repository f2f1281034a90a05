"""The mistakes by kind: each spoils a right pair in one way and says where, or says that it makes no sense there."""

from __future__ import annotations

from collections.abc import Mapping

from . import axes, conventions, dh, encoders, frames, joints, rows, runs, units, weights
from .spoilt import Maker, Spoilt

KINDS: Mapping[str, Maker] = {
    "unit-length": units.unit_length,
    "unit-angle": units.unit_angle,
    "sign": joints.sign,
    "permutation": joints.permutation,
    "offset": joints.offset,
    "handedness": axes.handedness,
    "inverse-pose": axes.inverse_pose,
    "rotation-convention": axes.rotation_convention,
    "dh-convention": dh.dh_convention,
    "frames-swapped": frames.frames_swapped,
    "base-missing": frames.base_missing,
    "tool-missing": frames.tool_missing,
    "rows-shifted": rows.rows_shifted,
    "duplicated-rows": rows.duplicated_rows,
    "joint-never-moves": rows.joint_never_moves,
    "sessions-mixed": rows.sessions_mixed,
    "all-si": conventions.all_si,
    "odd-unit": conventions.odd_unit,
    "one-column": conventions.one_column,
    "quaternion-order": conventions.quaternion_order,
    "table-rows": conventions.table_rows,
    "table-stated": conventions.table_stated,
    "counts": encoders.counts,
    "order": joints.order,
    "signs": joints.signs,
    "wrapped": encoders.wrapped,
    "coupled": encoders.coupled,
    "clock": encoders.clock,
    "whole-degrees": encoders.whole_degrees,
    "stands-still": encoders.stands_still,
    "rows-unit": runs.rows_unit,
    "tool-changed": runs.tool_changed,
    "base-moved": runs.base_moved,
    "grams": weights.grams,
    "gravity-reversed": weights.gravity_reversed,
}

__all__ = ["KINDS", "Maker", "Spoilt"]
