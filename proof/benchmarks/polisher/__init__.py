"""The hybrid polishing robot of Huang et al. (2019): an independent simulator and the studies of docs/machines/polisher.md.

``python -m benchmarks.polisher`` prints the tables and draws the figures; ``--bundle`` writes the demo's files.
"""
