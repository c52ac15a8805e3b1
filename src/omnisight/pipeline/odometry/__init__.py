"""Visual odometry, and the check of recordings for it."""
