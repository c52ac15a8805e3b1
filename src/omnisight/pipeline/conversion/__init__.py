"""Conversion, examination and comparison of calibrations."""
