"""Fluids against what is known of them, and what the answers cost: `softlab fluids --truth`."""
