"""Phase interop: an environment under the libraries that train with it."""

CHECKS = {}
FOLLOWERS = {}
