"""The comparison: policies in the same held-out rooms, and in scenarios in which they were not trained."""
