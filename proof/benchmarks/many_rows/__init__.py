"""Recordings of 10^4 to 10^6 rows, diagnosed: time, memory and the share of each stage, by the number of rows."""
