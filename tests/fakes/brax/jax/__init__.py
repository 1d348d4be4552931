from . import numpy, random


def jit(function):
    return function


def devices():
    return ["cpu"]
