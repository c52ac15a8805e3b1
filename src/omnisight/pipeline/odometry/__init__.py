"""Visual odometry, and the examination of its sequences."""
