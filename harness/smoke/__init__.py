"""The matrix as a pytest suite: `pytest --pyargs harness.smoke --matrix NAME`."""
