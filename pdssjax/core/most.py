"""The largest whole numbers that options and arguments take."""

MOST_DRAWN = 1_000_000
"""Replicates, draws of a chain or a point, cycles of a sweep; more are a slip of the keyboard."""

MOST_STARTS = 100_000
"""The same of fits from other starts."""

MOST_POINTS = 10_000_000
"""Values on an axis of a sweep, or points of a sample."""

MOST_WORKERS = 1024
"""The same of threads."""

MOST_SEED = 2**63 - 1
"""The greatest seed that every format of results can keep."""
