"""Studies: variations of configs, solved in parallel, collected, drawn and compared."""
