"""Real pixels: images, where they come from, and what is found in them. Reading images needs the extra `vision`."""
