"""Right machine files and recordings, the same with one mistake each, and what ``truepose check`` makes of them.

python -m benchmarks.mistakes -n 200 --seed S -o DIR
"""
