"""Runs that blow up: the largest stable step, when a state counts as diverged, why it did and what to do about it."""
