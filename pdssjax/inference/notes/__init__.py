"""What the user must read after a fit: each fact once, only where it is true, with what to do next."""
