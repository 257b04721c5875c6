"""What is seen of a run: figures, pages, stills."""
