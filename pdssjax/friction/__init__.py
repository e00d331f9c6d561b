"""The contact force between platform and end-effector, one law a file."""
