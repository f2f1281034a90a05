"""The machine file: its fields, units and messages."""
