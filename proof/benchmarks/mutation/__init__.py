"""Do the tests notice when the code is changed? Small changes (mutants) one at a time, and the tests that run the line.

Known tools do not fit, for facts. mutmut 3 changes nothing outside functions, where limits and units stand
(``SECONDS_PER_HOUR = 3600.0``), and takes a package from one source folder, while this one is laid out through links.
cosmic-ray changes the tree in place and runs one command for every mutant: the whole suite takes minutes. So mutants
come from ``ast``, the tests of a line from ``coverage``, and each mutant is tried in a forked child.
"""
