"""Studies of recordings that others measured: UR10 with a laser tracker, Stewart platform, Panda in sockets.

``stewart``, ``panda`` and ``ur10`` show what ``diagnose`` names and what is held out. ``remainder`` asks what is left
of the UR10 by linear least squares on top of one fit of geometry: ``linearised`` holds the derivatives,
``ladder`` adds one cause after the other, ``hypotheses`` tests what is not in it, ``repeats`` and ``orders`` look at
what no cause explains.
"""
