"""Charts of the studies; see ``truepose.charts``."""

from __future__ import annotations

from truepose.charts import Series, write_bars, write_chart

__all__ = ["Series", "write_bars", "write_chart"]
