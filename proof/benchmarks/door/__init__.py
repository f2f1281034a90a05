"""The law of the front door: what can be right is never called wrong, and what is wrong is never called ok.

python -m benchmarks.door --per-kind 6 --right 40 --seed 1 --jobs 2 -o DIR
"""
