"""`doctor`: what an environment holds, and what is wrong with it."""
