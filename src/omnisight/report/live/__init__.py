"""Pages that show a running command, served on this computer only."""
