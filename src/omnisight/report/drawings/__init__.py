"""Drawings of results: images with overlays (PNG) and technical drawings (SVG)."""
