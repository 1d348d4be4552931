"""Write a red cell as an issue for its upstream, with a script that reproduces it and private names redacted."""

__all__ = ["redacting", "upstream"]
