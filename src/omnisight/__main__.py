"""`python -m omnisight` is the command line."""

from omnisight.cli import run

run()
