"""Policies that learn: what is learned and how, the network and its weights, and what they reach."""
