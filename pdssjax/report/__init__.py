"""What people read: `text` for the terminal, `figures` for the folder of results."""
