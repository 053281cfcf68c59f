"""The environments: the only place where truth and belief meet."""
