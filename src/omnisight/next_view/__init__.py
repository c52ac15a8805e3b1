"""Where to hold the board for the next image."""
