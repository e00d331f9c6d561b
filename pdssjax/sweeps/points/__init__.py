"""Which points a sweep computes: a family, one way to choose them a file."""
