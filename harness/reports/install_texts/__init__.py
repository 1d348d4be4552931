"""Write a measured combination as a tool takes it: a command of pip or uv, `environment.yml`, TOML, a Dockerfile."""

__all__ = ["environment_files", "install_commands"]
