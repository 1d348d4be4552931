"""What runs without the harness, too: explaining a failure, looking at an environment.

In Python 3.7 to 3.14, with the standard library and itself alone. The host imports it and adds types;
`simmatrix-doctor.pyz` carries it to where no new Python is.
"""
