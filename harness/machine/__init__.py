"""Know and use this machine: processes under the supervisor, files and locks, interpreters, displays, memory."""
