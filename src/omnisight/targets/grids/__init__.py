"""Grids of corners in an image: found, checked and measured, whatever they are printed on."""
