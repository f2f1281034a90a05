"""Robot programs whose targets are corrected where they stand: KUKA, ABB, Universal Robots, and tables of points.

``correct.correct`` does it. Below it: a ``Dialect`` (``dialects``) finds the targets of a text and the numbers they are
written with, a ``Form`` (``forms``) turns those numbers into poses and back, a ``Configuration`` (``configurations``) tells
which of several solutions of the joints a target means, and ``branches`` finds these. Nothing of a text changes but numbers
of targets.
"""
