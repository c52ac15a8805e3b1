"""Comparisons with other libraries and evaluations of the accuracy; see `python -m benchmarks --help`."""
