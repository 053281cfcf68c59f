"""Watching an episode: in a window, as an animation, as a recording or as trajectories."""
