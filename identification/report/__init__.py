"""Results as people and programs read them: the only place that words, rounds, draws, and writes JSON and HTML.

``pages`` puts the report of a diagnosis or a calibration together, ``results`` and the ``*_words`` modules write
JSON and sentences, ``terminal`` the lines of a command. A page is a ``Document`` of plain blocks (``document``):
``sections`` arrange them, ``figures`` draws, ``render`` writes the page. Nothing is estimated here.
"""
