"""Answer from all measured results: which versions work together, which traps are known, what was never tried."""
