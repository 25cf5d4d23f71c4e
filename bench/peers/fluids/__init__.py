"""Other programs that run the lab's fluids."""
