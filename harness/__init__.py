"""Which versions of Python, gym, gymnasium and simulators work together: measured, with evidence."""
