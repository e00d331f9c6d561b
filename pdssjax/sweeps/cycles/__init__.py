"""Which cycle of a motion a sweep measures: a family, one choice a file."""
