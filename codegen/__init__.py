"""Native code from a symbolic model: the controller's C, and batches in Python.

``c.generate`` writes the C of a machine. In ``evaluation``, ``batch.BatchFunction`` evaluates expressions over many
rows and ``gram.GramFunction`` sums their squares and products; ``batch.Engine`` says when both are compiled
(``compiled`` makes and keeps the libraries).
Below them: ``expressions`` (a shared graph of scalar operations), ``printer`` (that graph as C), ``lanes`` (the same for
several rows at once), ``layout`` (scales, ranges and starts of the solver), ``texts`` (identifiers and templates),
``reference`` (poses for test vectors).
"""
