"""Proposal of the next calibration image by sequential G-optimal design."""
