"""How much there is to be had: constants, greedy, learned and planning policies between their bounds."""
