"""Simulated machines that err with what columns beyond the joints record, and the study of ``truepose diagnose`` on them.

python -m benchmarks.drivers [MACHINES] [JOBS]
"""
