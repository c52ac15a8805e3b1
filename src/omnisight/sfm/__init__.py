"""Structure from motion: poses of images and points from matches, for any camera and any rig."""
