"""The solver: Levenberg-Marquardt steps within bounds, the loop around them, and the reason why a run ends."""
