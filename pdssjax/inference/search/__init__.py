"""Fits from several starts, so that the lowest minimum is found, and the rules when they are worth their cost."""
