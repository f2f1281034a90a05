"""Results as people and programs read them: the only place that words, rounds, draws, and writes JSON and HTML.

``diagnosis`` and ``estimate`` make the document of a diagnosis, a calibration or an estimate, top to bottom, from sections and
sentences of the other modules; ``results`` writes JSON, ``frames`` tables of pandas, ``files`` a command's files. Nothing is
estimated here.
"""
