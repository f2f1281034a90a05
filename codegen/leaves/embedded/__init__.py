"""Generated C on controllers: compiled for a Cortex-M, run by QEMU against its test vectors, and measured.

``measure.measure`` gives the figures. ``section`` generates C with its figures and tells them in a README. Below:
``program`` (what a directory of generated C holds, the test program, and sizes) and ``toolchain`` (the controllers, the
programs needed, and a run in the emulator; nothing else of truepose needs them).
"""
