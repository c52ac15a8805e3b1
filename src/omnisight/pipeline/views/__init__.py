"""Views of images and clips, and maps for other programs."""
