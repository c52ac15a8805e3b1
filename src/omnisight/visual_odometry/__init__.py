"""Visual odometry: the trajectory of a moving camera or rig, frame by frame."""
