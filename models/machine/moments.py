"""Dates as seconds on one clock, the same on every computer."""

from __future__ import annotations

import datetime


def seconds_since_1970(moment: datetime.datetime) -> float:
    """Return a date in s; one without a zone is taken as UTC, whatever the zone of this computer."""
    zone = moment.tzinfo or datetime.UTC
    return moment.replace(tzinfo=zone).timestamp()
