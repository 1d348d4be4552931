"""Hold released libraries, whole and unchanged; README.md says which."""
