"""Work over many files, on one machine or a cluster, that survives being killed anywhere."""
