"""Robot programs whose targets are corrected where they stand: KUKA, ABB, Universal Robots, and tables of points.

``correct.correct`` does it, and runs what it wrote. Below it: a ``Dialect`` (``dialects``) finds the targets of a
text and the numbers they are written with, and ``flow`` which assignments a motion sees and what motions make of one literal.
In ``program`` a ``Form`` turns numbers into poses and back, and a ``Configuration`` tells which of several solutions of the
joints a target means; ``meaning`` finds these. Nothing of a text changes but numbers of targets, and names of targets where a
motion gets a literal of its own.
"""
