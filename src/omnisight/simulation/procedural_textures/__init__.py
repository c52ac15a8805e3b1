"""Procedural textures, reproducible by a seed: materials, room decor, streets and the sky."""
