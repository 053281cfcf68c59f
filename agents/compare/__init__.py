"""The comparison: policies in the same held-out rooms, and in scenarios in which they were not trained."""

from agents.compare.command import Args, compare, main

__all__ = ["Args", "compare", "main"]
