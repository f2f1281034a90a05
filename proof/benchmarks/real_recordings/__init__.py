"""Recordings that others measured: what ``truepose diagnose`` says of them, and what it cannot say by itself.

``prepared`` marks rows that are held out, ``unseen`` tells what a diagnosis is worth on them, ``campaigns`` compares what
two campaigns of one arm say of its joints, and ``panda`` calibrates an arm by a ball in sockets.
"""
