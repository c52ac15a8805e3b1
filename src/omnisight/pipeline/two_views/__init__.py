"""Epipolar geometry and stereo of two images."""
