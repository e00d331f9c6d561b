"""What a record may measure, one kind a file: `measures` in a study."""
