"""The truth: rooms, the camera's real motion, and what it detects. Nothing here knows of a belief."""
