"""The paper's equations of motion as matrices."""
