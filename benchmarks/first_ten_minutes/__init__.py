"""A new user's first ten minutes: an arm that is not bundled, its data sheet, a tracker's text file, and commands alone.

python -m benchmarks.first_ten_minutes [-o DIR] [--seeds 4]
"""
