"""Design of mirror cameras: from field of view, sensor and sizes to the mirror, its lens and their performance."""
