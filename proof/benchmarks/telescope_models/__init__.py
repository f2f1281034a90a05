"""Four models of the telescope times three of its platform: sections 3 to 7 of Gayral and Daney, RR-8096 (2012).

    python -m benchmarks.telescope_models [-n TELESCOPES] [-o FIGURES]

Measurements come from ``telescope_simulator``, which shares no code with truepose: a ring of beam elements on
flexures. Everything is fitted through truepose's general API; nothing here knows how a telescope is fitted.
"""
