"""Detection of boards in images."""
