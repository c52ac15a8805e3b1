"""Draws what faces show: decor of rooms, materials, the street and the sky; the same at every run."""
