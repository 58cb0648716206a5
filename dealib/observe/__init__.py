"""What is measured of a converged state."""
