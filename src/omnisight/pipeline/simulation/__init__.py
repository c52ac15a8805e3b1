"""Rendered images with known poses."""
