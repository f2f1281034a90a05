"""The arm of which most tests of reports tell."""

from support.report_fixtures import machine, plain

__all__ = ["machine", "plain"]
