"""The right minimum: where else a fit is begun, and when that is worth its cost."""
