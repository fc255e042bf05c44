"""From an image to a Detection. Pure."""
