"""Read, write and lock files: bounded, atomically, and as hostile data where somebody else left them."""

__all__ = ["cache_path", "file_locks", "given_files", "guarded_files", "scratch_folders"]
