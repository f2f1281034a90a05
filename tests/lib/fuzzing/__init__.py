"""Mutants of every kind of file that truepose reads, each given to a command: accepted or refused in one line, nothing else.

``python -m fuzzing -n 10000`` (with ``tests/lib`` on the path) tries all kinds and prints a table; see ``__main__``.
"""
