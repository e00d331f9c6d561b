"""The stack before the friction: peaks of its steps, then its parameters held with the errors they have."""
