"""Images, cameras and work folders that several capabilities read."""
