"""Bird's-eye views of the cameras of a vehicle."""
