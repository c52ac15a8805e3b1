"""Calibration of one camera, and what precedes and follows it."""
