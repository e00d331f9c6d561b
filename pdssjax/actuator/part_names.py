"""What the parts of a rig besides piezo and friction are called; nothing is loaded to tell it."""

PART_NAMES = ("effector", "stop", "amplifier", "sensor")
"""Each is the class of that name in the file of that name."""
