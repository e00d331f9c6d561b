"""Text as TOML writes it."""

import json


def quoted(text: str) -> str:
    """A `text` as a string of TOML, in quotation marks."""
    # What JSON escapes TOML escapes alike, but for the last control character.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
