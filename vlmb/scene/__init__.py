"""The scene: text to frozen data. No mechanics."""
