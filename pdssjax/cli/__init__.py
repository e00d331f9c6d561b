"""The command `pdssjax`: one file a command, `main` for what they share.

The top floor: imports any room, and no room imports it.
"""
