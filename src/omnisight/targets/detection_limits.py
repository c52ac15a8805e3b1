"""Limits that all detectors share."""

# Pixels of the image that is searched: larger images are reduced first, and measured in full.
MAX_SEARCH_PIXELS = 2_500_000
# Distance of a point from its prediction over the distance to its neighbour: half a step would be ambiguous, and
# distortion uses up a part of it.
SEARCH_RADIUS_STEPS = 0.3
# Contrast of a point over the median of its board: below, it is a shadow or a reflection.
MIN_RELATIVE_CONTRAST = 0.2
# Difference between two gray levels of the same paper, or of the same darkness, over the board's contrast.
MAX_LEVEL_DIFFERENCE = 0.3
# Share of a window's variance that the model of a point must explain, and its median over a board.
MIN_EXPLAINED, MIN_MEDIAN_EXPLAINED = 0.6, 0.8
# Part of a board's points that must be detected without other evidence of its position.
MIN_BOARD_SHARE = 0.4
