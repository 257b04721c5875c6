"""The version, here alone: the package, its metadata and stored trajectories read it from this file."""

__version__ = "0.1.0"
