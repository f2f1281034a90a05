"""Recordings in workbooks."""
