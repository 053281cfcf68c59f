"""Helpers of every command: arguments, files, sections of Markdown pages."""
