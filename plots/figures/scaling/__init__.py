"""How much faster more of something is: threads, GPUs."""
