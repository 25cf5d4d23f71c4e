"""Figures of speed-up by more threads and more GPUs."""
