"""A simulated arm whose constants move between sessions, and the study of ``truepose drift`` on it.

python -m benchmarks.drifting_arm [SEQUENCES] [JOBS]
"""
