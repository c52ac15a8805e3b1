"""Checks of recordings before they are used, and of the installation."""
