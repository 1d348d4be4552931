"""Make environments from wheels, know what lies in them, and find what changed in them since."""

__all__ = ["bytecode", "environments", "first_import", "site_packages"]
