"""The version of the program, for results that say where they come from."""

VERSION = "0.2.0"
