"""Generated C on controllers: compiled for a Cortex-M, run by QEMU against its test vectors, and measured.

``measure.measure`` gives the figures, ``section.sizes_section`` tells them in a README, ``targets`` lists the
controllers. Below: ``source`` (what a directory of generated C holds), ``program`` (the test program, and sizes),
``emulator`` (its run), ``frames`` (stack by the compiler's account), ``write`` (generate and measure),
``toolchain`` (the programs needed; nothing else of truepose needs them).
"""
