"""Poses of images in a map that was made from other images."""
