"""Conversion, inspection and comparison of calibrations."""
