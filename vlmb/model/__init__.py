"""The mechanism: a scene as a Pinocchio model, its coordinates and their names."""
