"""Builders of mechanisms: one file per ``mechanism.type`` of the machine file."""
