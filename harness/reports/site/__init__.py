"""Build a static site from reports: pages that are opened from disk or any web host, without a network.

Everything from a report is untrusted text here. Templates escape it, scripts show it as text, and of the files of a
report only logs, locks and pictures are copied.
"""

__all__ = ["build_site"]
