"""Reports and viewers (HTML files that need no network) and drawings of results."""
