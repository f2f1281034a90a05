"""Robot programs whose targets are corrected where they stand: KUKA, ABB, Universal Robots, and tables of points.

``correct.correct`` does it, and runs what it wrote. Below it: a ``Language`` says how constants, motions and frames are
written, ``reader`` finds with it the targets of a text, and ``flow`` which assignments a motion sees. In ``program`` a
``Form`` turns numbers into poses and back, and a ``Configuration`` tells which of several solutions of the joints a target
means; ``meaning`` finds these. Nothing of a text changes but numbers of targets, and names of targets where a motion gets a
constant of its own.
"""
