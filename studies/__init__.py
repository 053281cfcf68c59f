"""Studies: each is a list of conditions and a measure, run by one command."""
