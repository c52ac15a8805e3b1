"""Mirrors made to order: from a field of view, a sensor and a size to a mirror, its lens, and what they show."""
