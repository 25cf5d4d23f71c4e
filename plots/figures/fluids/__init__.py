"""Figures of fluids: how far they are off what is known, and where their time goes."""
