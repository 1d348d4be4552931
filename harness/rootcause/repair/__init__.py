"""Repair: find the smallest change that turns a red cell green, and prove it by a rerun."""
