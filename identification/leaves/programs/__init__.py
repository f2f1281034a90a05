"""Robot programs whose targets are corrected where they stand: KUKA, ABB, Universal Robots, and tables of points.

``correct.correct`` does it, and ``run`` runs what it wrote. Below it: a ``Dialect`` (``dialects``) finds the targets of a
text and the numbers they are written with, ``flow`` which assignments a motion sees, and ``roles`` what motions make of one
literal. A ``Form`` (``forms``) turns numbers into poses and back, a ``Configuration`` (``configurations``) tells which of
several solutions of the joints a target means, and ``branches`` finds these. Nothing of a text changes but numbers of targets,
and names of targets where a motion gets a literal of its own.
"""
