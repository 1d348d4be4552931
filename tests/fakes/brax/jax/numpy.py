import numpy


def asarray(values):
    return numpy.asarray(values, dtype=numpy.float32)
