"""Cases: solved in parallel, kept by their physics; what studies and fits are made of."""
