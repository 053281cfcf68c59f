"""Policies that learn: the recipe, the network and its weights, their card, and the training."""
