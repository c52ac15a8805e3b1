"""Print boards at true scale, as vector graphics."""
