"""Generated C on controllers: compiled for a Cortex-M, run by QEMU against its test vectors, and measured.

``measure.measure`` gives the figures, ``section.table`` prints them. Below: ``program`` (what a directory of generated C holds,
and the test program made of it), ``toolchain`` (controllers, and the programs needed).
"""
