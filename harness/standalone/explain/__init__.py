"""`explain`: what a log says of a failure, and what to do."""
