"""Estimation of a camera and board poses from observations of calibration boards or of straight lines."""
