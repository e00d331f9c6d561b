"""The method: a Levenberg-Marquardt step within bounds, the loop around it, and the word on how it ended."""
