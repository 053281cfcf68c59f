"""Episodes as animations or trajectories."""
