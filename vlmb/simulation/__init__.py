"""A run: methods, events, the trajectory and its files."""
