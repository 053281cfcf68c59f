"""The paper's study: its figures redrawn from our runs, and a verdict with an interval on each of its claims."""
