"""What the commands are added to."""

import argparse
from typing import TypeAlias

Subcommands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""Of the command line: its `add_parser` makes the parser of one command."""
