"""Write records for the host: one JSON object a line, each line one write."""

import os

from .cell_originals import encode, fstat, getpid, open_file, write

LAST_WORDS = "simmatrix: the last line of the reply is written"
"""The text that the probe prints then: later events leave printed text only."""

LONGEST_MESSAGE = 20000
LONGEST_TRACEBACK = 60000


class RecordFile:
    """A file of records. Only the process that opened it writes to it: a forked child writes nothing."""

    def __init__(self, path):
        self.pid = getpid()
        self.seq = 0
        self._path = path
        self._open()

    def write(self, kind, **fields):
        """Append one record as one write."""
        if getpid() != self.pid:
            return
        record = dict(fields, kind=kind, seq=self.seq, pid=self.pid)
        self.seq += 1
        if not self._is_ours():
            self._open()
        write(self._file, (encode(record) + "\n").encode("ascii"))

    def _open(self):
        self._file = open_file(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        self._opened = _identity(self._file)

    def _is_ours(self):
        """Return whether the descriptor is still the file: a library that closes all of them may have it used again."""
        try:
            return _identity(self._file) == self._opened
        except OSError:
            return False


def _identity(descriptor):
    status = fstat(descriptor)
    return status.st_dev, status.st_ino


def shorten(text, limit):
    """Return text of at most `limit` characters: its beginning and its end, where the decisive line is."""
    if len(text) <= limit:
        return text
    half = (limit - 40) // 2
    return "{}\n[... {} characters ...]\n{}".format(text[:half], len(text) - 2 * half, text[-half:])
