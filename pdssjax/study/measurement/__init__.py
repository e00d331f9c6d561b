"""The measurements of records, one kind a file: `measures` in a study."""
