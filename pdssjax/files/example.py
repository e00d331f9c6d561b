"""Where the packaged example is."""

from pathlib import Path

EXAMPLE = Path(__file__).parents[1] / "example"
"""Folder of the packaged study."""
