"""Machines simulated without truepose: numpy and scipy only, physics by other means than the catalogue's.

No module of this package imports models, identification or codegen (``tests/challenge/test_simulator.py`` sees to it).
"""
