"""Keep probe runs by content: `cas/<sha256>` holds files, `ac/<key>` the runs that answer a key; nothing is altered."""
