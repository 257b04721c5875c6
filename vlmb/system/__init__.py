"""What acts on a mechanism: forces, springs, constraints, a programme, the start; accelerations from all of it."""
