"""Quality of a calibration: uncertainty, checks and verdict."""
