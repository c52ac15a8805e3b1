"""Calibration of the cameras of a rig."""
