"""Side-by-side measurements against the peers, in one process; `python -m benchmarks` prints the ratios."""
