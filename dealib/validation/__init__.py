"""Benchmarks: devices with reference numbers and tolerances, solved and compared."""
