"""Grids of corners in a picture: found, checked and measured, whatever they are printed on."""
