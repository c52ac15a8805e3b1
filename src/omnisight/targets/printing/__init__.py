"""Boards on paper: true to size, as vectors."""
