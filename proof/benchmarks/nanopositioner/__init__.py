"""The six-axis nanopositioner with one fibre interferometer: simulator, recordings, study and figures.

``tables``, ``geometry``, ``plan`` and ``recordings`` are an independent simulator: plain numpy after the paper's
equations, no code of truepose. ``study``, ``trajectories`` and ``charts`` use truepose on what it makes;
``reflection`` is the controller that turns the mirror about the spot of light.

    python -m benchmarks.nanopositioner             # the tables and figures of docs/machines/nanopositioner.md
    python -m benchmarks.nanopositioner --write DIR # the bundled recordings
"""
