"""The drawing of a machine on a report's first page: its poses, what was measured there, and which places are guilty."""
