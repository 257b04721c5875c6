"""Compiled kernels on plain arrays: links, equations, methods. They know no names, no scenes and no Pinocchio."""
