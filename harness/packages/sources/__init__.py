"""Make wheels: of sdists and checkouts, of releases whose metadata is patched, of software that the user supplies."""

__all__ = ["builds", "checkouts", "overlays", "sdists", "user_supplied"]
