"""Images, cameras and folders that the functions read."""
