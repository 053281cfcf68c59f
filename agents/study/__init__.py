"""The paper's study: its figures redrawn from our runs, and a verdict with an interval on each of its claims."""

from __future__ import annotations

from agents.study.command import Args, main

__all__ = ["Args", "main"]
