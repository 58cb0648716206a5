"""Studies: variations of configs that are solved in parallel, collected, drawn and compared."""
