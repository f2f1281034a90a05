"""A controller's 1 kHz loop with generated C, on simulated real machines: position errors before and after.

    python -m compensation_loop polisher -o out

``real_machines`` are numpy simulators of ``benchmarks/`` that share no code with truepose's models: they write a
recording, carry thermometers, obey commands and say how far off they stand. ``controller`` is given the drawing and the
recording, calibrates, writes C, compiles ``loop.c`` with it and runs it along one of ``paths``. README.md has the
figures.
"""

import benchmarks  # noqa: F401 - finds the simulators by their plain names
