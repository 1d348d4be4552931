"""Read, write and lock files: bounded, atomically, and as hostile data where somebody else left them."""
