"""Tasks: each is one function that reads like its algorithm, and one command of the command line."""
