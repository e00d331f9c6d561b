"""Step methods, one a file: how a smooth piece of a motion is advanced."""
