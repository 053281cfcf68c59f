"""Open-loop, greedy, learned and planning policies between their bounds."""
