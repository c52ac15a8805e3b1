"""Where to hold the board next: the picture that would make a camera surer of itself."""
