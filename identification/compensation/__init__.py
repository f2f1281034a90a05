"""Commands that make the real machine follow a path."""
