"""Turn a matrix file into a plan, without I/O: its shape, its ranges, its strategies, its changes, overlay recipes."""
