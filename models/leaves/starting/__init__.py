"""Machine files to start from (``truepose init``): a mechanism from somewhere, written with a word on every block.

``start`` for bundled nominal machines, ``table`` for Denavit-Hartenberg tables, ``urdf`` and ``mjcf`` for robot
descriptions; each gives a ``Start``, which ``written`` turns into a machine file and an empty recording.
"""
