"""Cases of studies and fits: solved in parallel, and kept by the key of their physics."""
