"""Hybrid systems, one a file: what moves, in which modes, and what happens at events."""
