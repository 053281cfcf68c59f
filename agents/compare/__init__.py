"""The comparison: policies in the same unseen rooms, and where they were not trained."""

from agents.compare.command import Args, compare, main

__all__ = ["Args", "compare", "main"]
