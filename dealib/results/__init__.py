"""Run directories: written while a run goes on, read without dolfinx."""
