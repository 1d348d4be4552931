"""Find which versions of Python, gym, gymnasium and simulators work together."""
