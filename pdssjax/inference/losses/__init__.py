"""Losses: what a residual costs, for records with glitches.  A family: one member a file."""
