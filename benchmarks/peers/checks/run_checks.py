"""Runs the check files in one process: importing the library four times over would be the tools' whole time."""

import check_render
import check_single
import check_vector_async
import check_vector_sync

FILES = (check_single, check_vector_sync, check_vector_async, check_render)
