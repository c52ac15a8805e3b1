"""Maps, localization in them, and the visual compass."""
