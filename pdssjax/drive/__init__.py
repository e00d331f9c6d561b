"""The voltage on the piezo stack, one waveform a file."""
