"""Why an integration did not finish, in words: a run carries the index."""

FAILURES = (
    "",
    "the integration ran out of steps before the end of the record: look for a stiffness, frequency or bandwidth that "
    "is too high, take a shorter record, or allow more steps (in Python: `Accuracy(max_steps=...)`)",
    "the motion did not stay finite",
)
