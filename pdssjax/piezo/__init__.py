"""The motion of the platform under a voltage, one model a file."""
