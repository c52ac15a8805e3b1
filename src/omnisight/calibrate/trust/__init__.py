"""How far a calibration can be trusted: its covariance, where it was tested, and a verdict."""
