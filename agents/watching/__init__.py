"""Episodes and live recordings as animations, trajectories or files for the Rerun viewer."""
