"""What a sweep will take, as plain text."""

from typing import TYPE_CHECKING

from ._layout import aligned_table, heading

if TYPE_CHECKING:
    from ...sweeps import Forecast


def format_forecast(forecast: "Forecast", size: int) -> str:
    """Points, blocks, room on the disk (`size` [bytes]) and time of a sweep that has not been run."""
    minutes = forecast.seconds / 60.0
    rows = [
        ["points", str(forecast.points), f"{forecast.skipped} of them skipped" if forecast.skipped else ""],
        ["blocks", str(forecast.blocks), f"of {forecast.lanes} points, a chunk of the store each"],
        ["room on the disk", f"{size / 1e6:.3g} MB", "at most"],
        ["compilation", f"{forecast.compile_seconds:.3g} s", "once; less where it is kept from an earlier run"],
        ["a block", f"{forecast.block_seconds:.3g} s", "alone, mean of some that were timed"],
        ["the sweep", f"{minutes:.3g} min", f"on {forecast.workers} workers with a core each"],
    ]
    return heading("What this sweep takes") + aligned_table("<><", rows)
