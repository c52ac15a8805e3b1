"""The family of convergence tolerances: relative decreases of the cost at which minimizations stop."""

# Poses and starts that are refined again later.
COARSE_TOLERANCE = 1e-3
# Fits that are compared with each other: their costs differ by more.
COMPARISON_TOLERANCE = 1e-5
# Final results: the remaining error is far below the standard deviations.
FINAL_TOLERANCE = 1e-9
