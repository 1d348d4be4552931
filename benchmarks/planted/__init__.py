"""Planted changes of known sizes, and the table of what comparisons say of them."""
